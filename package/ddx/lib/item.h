/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* What a handle is made of, for the files of this library. */
#ifndef DDX_ITEM_H
#define DDX_ITEM_H

#include <poll.h>

#include "futex.h"
#include "lock.h"
#include "memory.h"
#include "queue.h"
#include "ring.h"

#define DDX_RETRY 50000000         /* ns between attempts to find the store again */
#define DDX_ANSWER_WAIT 5000000000 /* ns that the store may take to answer */

struct ddx_store_id {
    int port;
    DDX_STORE_ITEM *items; /* under ddx_keeper_lock() */
};

/* One epoch as this handle has it mapped, for one of its roles. */
struct ddx_term {
    struct ddx_control *control;
    uint32_t epoch;
    unsigned slots_coming; /* of those that the store announced with the epoch: not told of yet */
    uint64_t former_last;  /* number of the last frame of the epoch before */
    bool writable;
    void *base[DDX_SLOTS_MAX]; /* NULL: not mapped (yet) */
    int fd[DDX_SLOTS_MAX];
    int control_fd;
    int mismatch;           /* -errno if the caller's type cannot take the item's values */
    struct ddx_span *spans; /* between the item's layout and the caller's */
    unsigned span_count;
    struct ddx_layout *layout;
    struct ddx_runs runs;
};

struct ddx_reader_role {
    struct ddx_term *term, *coming; /* `coming` waits for its slots, and for the frame that is held in `term` */
    struct ddx_pin_page *page;
    uint64_t seen;
    int held;             /* slot that ddx_store_acquire() gave, or -1 */
    bool waiting;         /* ddx_reader_take() sleeps, unlocked, ... */
    bool both;            /* memory for both of its pins at once */
    bool in_order;        /* it last asked for the oldest frame not yet seen */
    uint32_t waits_since; /* ... and has seen as much news: `changed` below */
    uint64_t missed;
    unsigned keep;
    int pin_fd, hold_fd; /* -1: not attached */
    /* ddx_store_read_direct() */
    void *window;
    uint64_t window_bytes;
    bool window_copied; /* holds copies, since the caller's layout is not the item's */
    struct ddx_term *shown_term;
    int shown;  /* slot that the window shows, or -1 */
    uint32_t shown_generation; /* and what it must still be for that */
    int placed; /* slot whose pages are in the window: `shown`; the one that probably comes next while the reader waits;
                 * or -1, when who looks at the window faults in what is shown */
};

struct ddx_writer_role {
    struct ddx_term *term;
    int notice_fd, hold_fd;
    struct ddx_notice *notice;
    struct ddx_ring_writer ring;
    int pin_fd[DDX_READERS_MAX]; /* parallel to ring.reader */
    bool confirmed[DDX_READERS_MAX]; /* the store that runs now told of it */
    bool leaving[DDX_READERS_MAX];   /* and that it left; it stays until the kernel says so, too */
    unsigned leaving_count;
    unsigned offered; /* slots that the store was told of when it came back: what it tells readers */
    uint64_t unseen[DDX_READERS_MAX]; /* numbers of the pin pages that it could not take: their readers may be in */
    unsigned unseen_count;
    bool refused;    /* a slot that was added could not be taken: nor can the reader that it was for */
    int loaned;      /* slot, or -1 */
    bool superseded; /* another writer took over while no store could tell us */
    uint64_t lost;   /* what was published since then */
    uint64_t given_up; /* writes, for want of a free slot */
};

struct ddx_store_item {
    /* What a delivery needs is in the first cache line: it is cold whenever a frame comes. */
    _Alignas(64) ddx_lock lock; /* for keeper and caller, who both take messages in */
    ddx_word changed;           /* counts messages taken in; a reader without a term sleeps on it */
    struct ddx_reader_role reader;
    struct ddx_writer_role writer;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *next, *next_of_id; /* under ddx_keeper_lock() */
    struct pollfd listen;              /* only for the keeper: where news came from when it last looked */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as the store last told, or as wanted */
    uint32_t layouts;          /* so many before it */
    struct ddx_layout *own;    /* the caller's struct, NULL if it knows none */
    struct ddx_field *fields;  /* of the layout, for ddx_store_field() */
    bool deaf;                 /* for want of descriptors: what came over this connection is not complete */
    int socket;                /* -1: the store is gone; the keeper tries again */
    int64_t retry;             /* when */
    struct ddx_queue queue;    /* what the store has no room for yet; the keeper goes on */
    uint64_t heard;            /* number of the last message taken in */
    struct ddx_packet *packet;
    uint32_t answer; /* operation that a request waits for, and what came */
    bool answered;
    struct ddx_message reply;
};
static_assert(offsetof(struct ddx_store_item, reader.missed) <= 64, "one cache line");

/* term.c: mapping and unmapping. Both take ownership of control_fd, also on failure. */
int ddx_term_new(struct ddx_term **term, uint32_t epoch, const struct ddx_layout *layout, const struct ddx_layout *own,
                 int control_fd, bool writable);
int ddx_term_add_slot(struct ddx_term *term, unsigned slot, int fd);
void ddx_term_free(struct ddx_term *term);

/* inbox.c: take in what the store said. With `lock` held. 0 or -EPIPE when the store is gone. */
int ddx_item_service(DDX_STORE_ITEM *item);
/* Send, then wait for `answer`. With `lock` held. 0, the answer's status, -ECONNREFUSED. */
int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer);
void ddx_item_disconnect(DDX_STORE_ITEM *item);
/* The layout that ddx_store_field() describes; does nothing if it is that already. 0, -ENOMEM. */
int ddx_item_set_layout(DDX_STORE_ITEM *item, const struct ddx_layout *layout);

/*
 * Forget readers whose pin page nobody holds any more: those that are leaving, or all of them. The store's word is not
 * enough, it may have hung up on one that was stopped. True if there were any.
 */
bool ddx_writer_forget(struct ddx_writer_role *writer, bool all);

/* offer.c: after the store came back. With `lock` held. */
int ddx_item_offer(DDX_STORE_ITEM *item);

/* reader.c */
/* What this reader has seen, from now on; in its pin page, too, if it has one. */
void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence);
/*
 * Wait for a frame as `tail` says and pin it with pin number `pin`. With `lock` held (given up while sleeping). On
 * success frame->slot is pinned in item->reader.term. What the pin held before stays held until then.
 */
int ddx_reader_take(DDX_STORE_ITEM *item, unsigned pin, struct ddx_ring_frame *frame, uint64_t *missed, double timeout,
                    int tail);
/*
 * With `lock` held: is the reader asleep since before the news? Then wake it, and ask again soon: it may be just about
 * to fall asleep, and it sleeps on one word only, which is the writer's.
 */
bool ddx_reader_wake(const DDX_STORE_ITEM *item);
void ddx_reader_follow(DDX_STORE_ITEM *item); /* go over to the coming term, if nothing is held */
void ddx_reader_end(DDX_STORE_ITEM *item);

/* direct.c, for a reader that is about to sleep: most of what the next frame needs is done when it comes. */
void ddx_direct_prepare(struct ddx_reader_role *reader);
/*
 * No newer frame could be pinned: pin again what the window shows. False if that was written over meanwhile, so that
 * the window needs another one. True also if it shows nothing, or one of an epoch that has ended.
 */
bool ddx_direct_keep(struct ddx_reader_role *reader);
/* The window shows nothing that anybody may rely on. */
void ddx_direct_withdraw(struct ddx_reader_role *reader);

/* writer.c */
int ddx_writer_claim(DDX_STORE_ITEM *item);
void ddx_writer_end(DDX_STORE_ITEM *item);

/* keeper.c: the thread that listens to the store for all items of this process. */
void ddx_keeper_lock(void);
void ddx_keeper_unlock(void);
void ddx_keeper_wake(void); /* there is something in an item's queue */
int ddx_keeper_add(DDX_STORE_ITEM *item);     /* takes its own lock */
void ddx_keeper_remove(DDX_STORE_ITEM *item); /* afterwards the keeper does not touch it */

void ddx_message_init(struct ddx_message *message, uint32_t operation, const DDX_STORE_ITEM *item);

#endif
