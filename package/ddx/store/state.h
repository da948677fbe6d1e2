/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The store's state: items, their holders and memory files. One thread; nothing here is on the frame path.
 *
 * Layers, from below (checked by tests/host/test_layers.py): log, checkpoint, holder and files - epochs and items - the
 * budget with the share of each process, and messages to holders (send) - terms of reading and writing (readers, claim,
 * adopt) - sessions - the worker (main), and its takeover from the previous one (resume).
 */
#ifndef STORE_STATE_H
#define STORE_STATE_H

#include "../lib/memory.h"
#include "../lib/queue.h"
#include "../lib/ring.h"
#include "files.h"
#include "checkpoint.h"

/* The memory files of one writer's term. */
struct epoch {
    uint32_t number;
    struct ddx_layout *layout;
    uint64_t digest; /* of its bytes */
    struct ddx_runs runs;
    int control_fd;
    int readers_fd; /* the same file as sent to readers: the kernel shows whether any has it; -1: sent to none yet */
    struct ddx_control *control;
    bool control_ready; /* the writer has mapped and sealed it: readers may have it */
    unsigned slots;
    unsigned wanted; /* slots needed before the epoch begins; above `slots` while the worker makes some in each turn */
    int slot_fd[DDX_SLOTS_MAX];     /* -1: does not exist */
    bool slot_told[DDX_SLOTS_MAX];  /* sent to the writer */
    bool slot_ready[DDX_SLOTS_MAX]; /* the writer has mapped and sealed it */
};

/* A process that is a client, or was one and has left items: see budget.h. */
struct process {
    struct process *next;
    int32_t pid; /* 0: all processes of other pid name spaces together */
    unsigned clients;
    struct checkpoint_account account;
    bool is_reported; /* the log has the line that it got no more memory */
    uint32_t turn;    /* turn of the worker that last handled a message of it */
    unsigned heard;   /* messages handled in that turn */
};

struct client {
    struct store *store;
    struct client *next;
    struct process *process;
    int socket;
    uint64_t handled;       /* number of its last handled request */
    struct ddx_queue queue; /* messages to be sent after the commit, when its socket has room */
    int32_t pid;
    bool gone;
    bool early; /* its request must wait until the store is open: see session.c */
    struct item *item;
    /* as a reader: */
    uint32_t id; /* 0: does not read */
    unsigned keep;
    bool admitted;    /* the writer checks its pins, or will before it writes: it may get frames, and pin them */
    bool unseen;      /* the writer cannot check its pins, and is notified repeatedly */
    int64_t told_at;  /* time of the last notification */
    uint32_t version; /* of the notice, when the writer was notified */
    unsigned asked;   /* frames requested by its unanswered ATTACH, 0: none */
    int64_t asked_at;
    uint64_t asked_after; /* the newest frame at that time */
    bool counted;         /* by the writer: frames are kept for it */
    int pin_fd;
    const struct ddx_pin_page *pin;
    /* its offer after a restart of the store, until OFFER_END */
    struct epoch *offered;
    int offered_notice_fd, offered_pin_fd;
    unsigned offered_keep;
    uint32_t offered_seen; /* version of the notice up to which it knows the readers */
    /* during LIST: the last item sent */
    bool listing;
    char listed[DDX_NAME_MAX + 1];
};

#define ENDED 8 /* terms whose end is remembered */

struct ended {
    uint32_t epoch;    /* 0: none */
    uint64_t sequence; /* of its last frame, as carried over into the next epoch */
};

struct item {
    struct store *store;
    struct item *next; /* sorted by name */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as the first client declared it; NULL: see item_layout() */
    struct epoch *epoch;       /* the current one, which readers use */
    struct epoch *pending;     /* a new writer prepares this one */
    struct client *writer;
    bool foreign; /* its epoch came from an offer: there may be a newer one */
    bool adopted; /* known from an offer after a restart; its writer may live without having reported */
    bool away;    /* its writer disconnected; if it lives, it will reconnect */
    uint32_t epochs, handles, readers, keep_total;
    uint32_t numbered; /* the last epoch that files were made for; it may not have begun */
    int notice_fd;
    struct ddx_notice *notice;
    uint32_t announced; /* version of the notice once all readers were announced to the writer */
    uint32_t taken;     /* the version up to which the writer has answered: it checks their pins, or cannot */
    uint32_t counted;   /* the notice's count of readers once all messages are sent */
    uint64_t sequence;  /* of the last epoch's last frame */
    struct ended ended[ENDED];
};

/* An epoch that has ended: see items.c. */
struct retired {
    struct retired *next;
    const struct item *item; /* NULL: it was dropped */
    uint64_t bytes;
    int watch; /* a description of the control page that no other process has */
};

/* Fixed at start-up, shared by all workers. */
struct settings {
    int port;
    int listener;
    uint64_t budget;
    bool restarted; /* a store ran here before: living holders will report */
};

/* The worker's state, all in checkpointed memory, so that the next worker continues with it. */
struct store {
    const struct settings *settings;
    struct item *items;
    struct client *clients;
    struct process *processes;
    struct retired *retired;
    struct files files;
    uint32_t next_reader;
    int64_t listened; /* ns that the store has been reading messages, without time when it was stopped */
    bool open;        /* running holders have had time to report: new clients are admitted */
    bool settled;     /* holders that have not reported are stopped or dead */
};

#endif
