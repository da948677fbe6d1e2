/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* What a handle is made of, for the files of this library. */
#ifndef DDX_HANDLE_H
#define DDX_HANDLE_H

#include <poll.h>

#include "lock.h"
#include "memory.h"
#include "queue.h"
#include "ring.h"

#define DDX_RETRY 50000000         /* ns between attempts to find the store again */
#define DDX_ANSWER_WAIT 5000000000 /* ns that the store may take to answer */

struct ddx_store_id {
    int port;
    char host[DDX_NAME_MAX + 1]; /* whose items are meant; "": this machine's */
    DDX_STORE_ITEM *items; /* under the keeper's lock */
};

/* One epoch as this handle has it mapped, for one of its roles. */
struct ddx_term {
    struct ddx_control *control;
    uint32_t epoch;
    unsigned slots_coming; /* announced by the store with the epoch, not received yet */
    uint64_t former_last;  /* number of the last frame of the epoch before */
    bool begins_again;     /* its numbers are below the ones that this reader has seen */
    bool writable;
    void *base[DDX_SLOTS_MAX]; /* NULL: not mapped (yet) */
    int fd[DDX_SLOTS_MAX];
    int control_fd;
    int mismatch;           /* -errno if the caller's type cannot take the item's values */
    int uncopied;           /* -errno if values are not copied: `mismatch`, or the caller's struct is not known */
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
                 * or -1, if the reader of the window faults in its pages */
};

struct ddx_writer_role {
    struct ddx_term *term;
    int notice_fd, hold_fd;
    struct ddx_notice *notice;
    struct ddx_ring_writer ring;
    int pin_fd[DDX_READERS_MAX]; /* parallel to ring.reader */
    bool confirmed[DDX_READERS_MAX]; /* announced by the running store */
    bool leaving[DDX_READERS_MAX];   /* reported as left; kept until the kernel confirms it */
    unsigned leaving_count;
    unsigned offered; /* slots offered to the restarted store, which announces them to readers */
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
    _Alignas(64) ddx_lock lock; /* for keeper and caller, which both take messages in */
    ddx_word changed;           /* counts messages taken in; a reader without a term sleeps on it */
    struct ddx_reader_role reader;
    struct ddx_writer_role writer;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *next, *next_of_id; /* under the keeper's lock */
    struct pollfd listen;              /* only for the keeper: where news came from when it last looked */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as the store last told, or as wanted */
    uint32_t layouts;          /* number of layouts before it */
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

/*
 * Under the lock: whether values may be copied to or from the caller's struct, as far as that can be known now.
 * -EPROTOTYPE: the item has a type that the caller has not declared, so the library does not know the struct's size.
 */
int ddx_item_copies(const DDX_STORE_ITEM *item);

/* The layout that ddx_store_field() describes; does nothing if it is that already. 0, -ENOMEM. */
int ddx_item_set_layout(DDX_STORE_ITEM *item, const struct ddx_layout *layout);

#endif
