/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The store's state: items, their holders and memory files. One thread; nothing here is on the frame path.
 *
 * Layers, from below (checked by tests/host/test_layers.py): messages, state and log (send, heap, checkpoint, files,
 * holder, log) - epochs and items - items that may be dropped (leftover) - the budget, descriptors, a process's share
 * (process), and messages to holders (notify) - terms of reading and writing (readers, claim, adopt) - requests and
 * sessions - the worker, and how the next one continues (resume).
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
    int readers_fd; /* the same file as readers get it: as long as one has it, the kernel tells; -1: none got it yet */
    struct ddx_control *control;
    bool control_ready; /* the writer has mapped and sealed it: readers may have it */
    unsigned slots;
    unsigned wanted; /* slots before it begins: more than there are while the worker makes them, some in each turn */
    int slot_fd[DDX_SLOTS_MAX];     /* -1: does not exist */
    bool slot_told[DDX_SLOTS_MAX];  /* the writer knows of it */
    bool slot_ready[DDX_SLOTS_MAX]; /* and has mapped and sealed it */
};

/* A process that is a client, or was one and has left items: see process.h. */
struct process {
    struct process *next;
    int32_t pid; /* 0: all those of other pid name spaces together */
    unsigned clients;
    struct checkpoint_account account;
    bool told; /* a line in the log says that it got no more memory */
    uint32_t turn; /* of the worker, in which it was heard last */
    unsigned heard; /* messages in that turn */
};

struct client {
    struct store *store;
    struct client *next;
    struct process *process;
    int socket;
    uint64_t handled;       /* number of its last request that was handled */
    struct ddx_queue queue; /* what is to be sent when all is committed, and it has read more */
    int32_t pid;
    bool gone;
    bool early; /* asks for something that it may not have yet: see session.c */
    struct item *item;
    /* as a reader: */
    uint32_t id; /* 0: does not read */
    unsigned keep;
    bool admitted;  /* the writer looks at its pins, or will before it writes: it may hear of frames, and pin them */
    bool unseen;    /* the writer cannot, and is notified repeatedly */
    int64_t told_at; /* time of the last notification */
    uint32_t version; /* of the notice, when the writer was told */
    unsigned asked; /* frames of its ATTACH that is not answered yet, 0: there is none */
    int64_t asked_at;
    uint64_t asked_after; /* the newest frame at that time */
    bool counted; /* by the writer: frames are kept for it */
    int pin_fd;
    const struct ddx_pin_page *pin;
    /* what it offers after our restart, until OFFER_END */
    struct epoch *offered;
    int offered_notice_fd, offered_pin_fd;
    unsigned offered_keep;
    uint32_t offered_seen; /* the notice's version up to which it has heard of readers */
    /* in the middle of LIST: the last item sent */
    bool listing;
    char listed[DDX_NAME_MAX + 1];
};

#define ENDED 8 /* terms whose end is remembered */

struct ended {
    uint32_t epoch;    /* 0: none */
    uint64_t sequence; /* of its last frame, as its successor carried it over */
};

struct item {
    struct store *store;
    struct item *next; /* sorted by name */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as wanted by the first that asked; NULL: see item_layout() */
    struct epoch *epoch;       /* readers see this one */
    struct epoch *pending;     /* a new writer prepares this one */
    struct client *writer;
    bool foreign; /* its epoch came from an offer: there may be a newer one */
    bool adopted; /* known from an offer after a restart; its writer may live without having reported */
    bool away;    /* its writer hung up; if it lives, it comes back */
    uint32_t epochs, handles, readers, keep_total;
    uint32_t numbered; /* the last epoch that files were made for; it may not have begun */
    int notice_fd;
    struct ddx_notice *notice;
    uint32_t announced; /* the notice's version when the writer has heard of all readers */
    uint32_t taken;     /* and of those whose pins it looks at, or has refused to */
    uint32_t counted;   /* the notice's count of readers once all messages are sent */
    uint64_t sequence; /* of the last epoch's last frame */
    struct ended ended[ENDED];
};

/* An epoch that has ended: see retired.h. */
struct retired {
    struct retired *next;
    const struct item *item; /* NULL: it is no more */
    uint64_t bytes;
    int watch; /* a description of the control page that no other process has */
};

/* What is so from the beginning, for all workers. */
struct settings {
    int port;
    int listener;
    uint64_t budget;
    bool restarted; /* a store ran here before: living holders will report */
};

/* A worker's state, which the next worker gets: all of it is in checkpointed memory. */
struct store {
    const struct settings *settings;
    struct item *items;
    struct client *clients;
    struct process *processes;
    struct retired *retired;
    struct files files;
    uint32_t next_reader;
    int64_t listened; /* ns that this store has read messages, without the time that it was stopped */
    bool open;        /* living holders that are awake have had time to report: new clients are admitted */
    bool settled;     /* holders that have not reported are stopped or dead */
};

#endif
