/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The parts of a handle; private to this library. */
#ifndef DDX_HANDLE_H
#define DDX_HANDLE_H

#include <poll.h>

#include "futex.h"
#include "memory.h"
#include "queue.h"
#include "ring.h"

/*
 * The keeper's eventfd, opened and closed by the keeper; -1 while the keeper does not run. A variable, so that this
 * layer does not depend on the keeper.
 */
extern int ddx_connection_waker __attribute__((visibility("hidden")));

#define DDX_RETRY_NS 50000000    /* between attempts to reconnect to the store */
#define DDX_ANSWER_NS 5000000000 /* that the store may take to answer */

struct ddx_store_id {
    int port;
    char host[DDX_NAME_MAX + 1]; /* machine of the items; "": this one */
    DDX_STORE_ITEM *items;       /* under the keeper's lock */
};

/* One epoch as mapped by this handle, for one of its roles. */
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
    int mismatch;           /* -errno if the caller's type cannot hold the item's values */
    int uncopied;           /* -errno if values cannot be copied: `mismatch`, or the caller's struct is not known */
    struct ddx_span *spans; /* between the item's layout and the caller's */
    unsigned span_count;
    struct ddx_layout *layout;
    struct ddx_runs runs;
};

struct ddx_reader_role {
    struct ddx_term *term, *coming; /* `coming` waits for its slots, and for the release of a frame held in `term` */
    struct ddx_pin_page *page;
    uint64_t seen;
    int held;             /* slot of ddx_store_acquire(), or -1 */
    bool waiting;         /* ddx_reader_take() sleeps, unlocked */
    bool both;            /* memory for both of its pins at once */
    bool in_order;        /* its last read asked for the oldest frame not yet seen */
    uint32_t waits_since; /* value of `changed` (below) when it began to sleep */
    uint64_t missed;
    unsigned keep;
    int pin_fd, hold_fd; /* -1: not attached */
    /* ddx_store_read_direct() */
    void *window;
    uint64_t window_bytes;
    bool window_copied; /* holds copies, because the caller's layout differs from the item's */
    struct ddx_term *shown_term;
    int shown;                 /* slot that the window shows, or -1 */
    uint32_t shown_generation; /* generation that `shown` must still have */
    int placed; /* slot whose pages are in the window: `shown`; while the reader waits, probably the next frame's slot;
                 * -1: an access to the window faults in its pages */
};

struct ddx_writer_role {
    struct ddx_term *term;
    int notice_fd, hold_fd;
    struct ddx_notice *notice;
    struct ddx_ring_writer ring;
    int pin_fd[DDX_READERS_MAX];     /* parallel to ring.reader */
    bool confirmed[DDX_READERS_MAX]; /* announced by the running store */
    bool leaving[DDX_READERS_MAX];   /* reported as left; kept until the kernel confirms it */
    unsigned leaving_count;
    unsigned offered;                 /* slots offered to the restarted store, which announces them to readers */
    uint64_t unseen[DDX_READERS_MAX]; /* numbers of pin pages that it could not map; their readers may read already */
    unsigned unseen_count;
    bool refused;      /* an added slot could not be mapped, so the reader that it was for is refused */
    int loaned;        /* slot, or -1 */
    bool superseded;   /* another writer took over while this handle had no connection to the store */
    uint64_t lost;     /* frames published since then */
    uint64_t given_up; /* writes without a free slot */
};

struct ddx_store_item {
    /* The fields of a delivery share the first cache line, because it is cold when a frame comes. */
    _Alignas(64) ddx_lock lock; /* for keeper and caller, which both receive messages */
    ddx_word changed;           /* counts received messages; a reader without a term sleeps on it */
    struct ddx_reader_role reader;
    struct ddx_writer_role writer;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *next, *next_of_id; /* under the keeper's lock */
    struct pollfd listen;              /* only for the keeper: the result of its last poll() */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as last received from the store, or as declared by the caller */
    uint32_t layouts;          /* number of layouts before it */
    struct ddx_layout *own;    /* the caller's struct; NULL if the library does not know it */
    struct ddx_field *fields;  /* of the layout, for ddx_store_field() */
    bool lost_files;           /* no free descriptor: a message of this connection arrived without its files */
    int socket;                /* -1: no connection; the keeper tries again */
    int64_t retry;             /* time of the next attempt */
    struct ddx_queue queue;    /* messages that the socket does not take yet; the keeper sends them */
    uint64_t heard;            /* number of the last message received */
    struct ddx_packet *packet;
    uint32_t answer; /* operation that a request waits for; then its answer */
    bool answered;
    struct ddx_message reply;
};
static_assert(offsetof(struct ddx_store_item, reader.missed) <= 64, "one cache line");

/*
 * Under the lock: whether values may be copied to or from the caller's struct, as far as this is known now. 0;
 * -EPROTOTYPE: the item has a type that the caller has not declared, so the library does not know the struct's size.
 */
int ddx_item_copies(const DDX_STORE_ITEM *item);

/* Set the layout that ddx_store_field() describes, if it differs. 0, -ENOMEM. */
int ddx_item_set_layout(DDX_STORE_ITEM *item, const struct ddx_layout *layout);

void ddx_message_init(struct ddx_message *message, uint32_t operation, const DDX_STORE_ITEM *item);

/* Open a new connection to the store. 0, or -errno, and then the handle is unchanged. */
int ddx_connection_open(DDX_STORE_ITEM *item);

/* Send; the keeper sends the messages that the socket does not take now. With `lock` held. As ddx_queue_send(). */
int ddx_connection_say(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                       const int *fds, unsigned fd_count);

/* Have the keeper look at all items. */
void ddx_connection_wake_keeper(void);

/* Both take ownership of the descriptor, also on failure. */
int ddx_term_new(struct ddx_term **term, uint32_t epoch, const struct ddx_layout *layout, const struct ddx_layout *own,
                 int control_fd, bool writable);
int ddx_term_add_slot(struct ddx_term *term, unsigned slot, int fd);
void ddx_term_free(struct ddx_term *term);

#endif
