/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Every state transition of the protocol, numbered and named, so that a test can kill or stop a program at each one.
 *
 * Only a build with DDX_FAULTS (the tests' own copies of library and store) has code at these points. There the
 * environment selects a fault:
 *
 *     DDX_FAULT=writer.published:3:kill[,...]    kill the program when it passes this point for the third time
 *
 * Other actions: `stop` (SIGSTOP); `end`: kill the store's worker and holder (`kill` kills only the worker); `die`: as
 * `end`, but not recorded in the journal; `slow`: sleep 20 ms at each later pass, to keep a race open.
 * DDX_FAULT_JOURNAL names a file of struct ddx_fault_journal that counts the passes of each point, for all programs.
 */
#ifndef DDX_FAULT_H
#define DDX_FAULT_H

/* clang-format off */
#define DDX_POINTS(X) \
    /* the frame path of the writer: ring.h has the steps */ \
    X(WRITER_CHOSEN,      "writer.chosen")      /* W1: a slot that is neither newest nor pinned */ \
    X(WRITER_MARKED,      "writer.marked")      /* W2: its generation is WRITING */ \
    X(WRITER_NEWS,        "writer.news")        /* W3: readers were added, mark undone */ \
    X(WRITER_UNCHANGED,   "writer.unchanged")   /* W3: no reader was added */ \
    X(WRITER_COLLIDED,    "writer.collided")    /* W4: a reader has pinned it, mark undone */ \
    X(WRITER_OWNS,        "writer.owns")        /* W4: no reader has */ \
    X(WRITER_WRITTEN,     "writer.written")     /* W5: the data is written */ \
    X(WRITER_NUMBERED,    "writer.numbered")    /* W5: number and time are written */ \
    X(WRITER_WHOLE,       "writer.whole")       /* W6: its generation is even */ \
    X(WRITER_PUBLISHED,   "writer.published")   /* W7: it is the newest */ \
    X(WRITER_WOKE,        "writer.woke")        /* W7: the readers were woken */ \
    X(WRITER_CANCELLED,   "writer.cancelled")   /* instead of W5: the slot is empty */ \
    /* a writer's term begins, changes, ends */ \
    X(CLAIM_SENT,         "claim.sent")         /* asked the store for the role */ \
    X(CLAIM_CONTROL,      "claim.control")      /* control page mapped and sealed, notice mapped */ \
    X(CLAIM_SLOT,         "claim.slot")         /* a slot mapped and sealed, not reported to the store */ \
    X(CLAIM_READY,        "claim.ready")        /* reported to the store */ \
    X(CLAIM_READER,       "claim.reader")       /* a reader's pin page is in the list */ \
    X(CLAIM_TAKEN,        "claim.taken")        /* and that was reported to the store */ \
    X(CLAIM_READER_GONE,  "claim.reader_gone")  /* a reader's pin page was removed from the list */ \
    X(CLAIM_GRANTED,      "claim.granted")      /* the readers were notified: frames may be written */ \
    X(CLAIM_ENDED,        "claim.ended")        /* unmapped, not reported to the store */ \
    /* the frame path of a reader */ \
    X(READER_CHOSEN,      "reader.chosen")      /* R1: a slot */ \
    X(READER_PINNED,      "reader.pinned")      /* R2: written to the pin page */ \
    X(READER_OVERTAKEN,   "reader.overtaken")   /* R3: overwritten already, unpinned */ \
    X(READER_HOLDS,       "reader.holds")       /* R3: the frame cannot change any more */ \
    X(READER_COUNTED,     "reader.counted")     /* missed frames are counted */ \
    X(READER_COPIED,      "reader.copied")      /* R4: the caller has a copy */ \
    X(READER_RELEASED,    "reader.released")    /* R5: unpinned */ \
    X(READER_WAITS,       "reader.waits")       /* nothing new: about to sleep */ \
    X(READER_UNMAPPED,    "reader.unmapped")    /* the frame is in a slot that was not announced yet */ \
    X(DIRECT_TAKEN,       "direct.taken")       /* R3 for the stable pointer: the former frame is still shown */ \
    X(DIRECT_WITHDRAWN,   "direct.withdrawn")   /* the former frame's pages are back in its slot */ \
    X(DIRECT_PREPARED,    "direct.prepared")    /* the pages of the probable next frame are in the window */ \
    X(DIRECT_RESTORED,    "direct.restored")    /* no frame came: the former frame's pages are in the window again */ \
    X(DIRECT_SHOWN,       "direct.shown")       /* the new frame's pages are in the window */ \
    /* a reader attaches and leaves */ \
    X(ATTACH_SENT,        "attach.sent")        /* asked the store for a reader's share */ \
    X(ATTACH_EPOCH,       "attach.epoch")       /* control page of an epoch mapped */ \
    X(ATTACH_SLOT,        "attach.slot")        /* one of its slots mapped */ \
    X(ATTACH_PAGE,        "attach.page")        /* pin page mapped */ \
    X(ATTACH_BOTH,        "attach.both")        /* memory for both pins at once */ \
    X(ATTACH_FOLLOWED,    "attach.followed")    /* switched to the next epoch */ \
    X(ATTACH_ENDED,       "attach.ended")       /* unmapped, not reported to the store */ \
    /* the thread that listens to the store, and its work after a restart of the store */ \
    X(KEEPER_HEARD,       "keeper.heard")       /* a message is waiting */ \
    X(KEEPER_LOST,        "keeper.lost")        /* the store disconnected */ \
    X(KEEPER_FOUND,       "keeper.found")       /* connected to its successor */ \
    X(KEEPER_OFFERED,     "keeper.offered")     /* control page (and notice) sent */ \
    X(KEEPER_SLOT,        "keeper.slot")        /* a slot sent */ \
    X(KEEPER_PIN,         "keeper.pin")         /* pin page sent */ \
    X(KEEPER_END,         "keeper.end")         /* all sent */ \
    X(KEEPER_ACCEPTED,    "keeper.accepted")    /* the store accepted the offer */ \
    X(KEEPER_SUPERSEDED,  "keeper.superseded")  /* the store refused it: another writer was admitted */ \
    /* the store: items and clients */ \
    X(STORE_LISTENS,      "store.listens")      /* clients can connect */ \
    X(STORE_CLIENT,       "store.client")       /* a client has connected */ \
    X(STORE_GONE,         "store.gone")         /* a client left or died, nothing released yet */ \
    X(STORE_ITEM,         "store.item")         /* a new item in the list */ \
    X(STORE_OPENED,       "store.opened")       /* a handle counts, not reported to its program */ \
    X(STORE_DROPPED,      "store.dropped")      /* an item was removed from the list */ \
    X(STORE_HANDLED,      "store.handled")      /* a request was handled, nothing committed */ \
    X(STORE_COMMITTED,    "store.committed")    /* committed, and the request is still in the socket */ \
    X(STORE_DISCARDED,    "store.discarded")    /* request removed from the socket, no reply sent */ \
    X(STORE_SAID,         "store.said")         /* reply sent, which is not committed */ \
    /* the store: a change of writer */ \
    X(STORE_PREPARED,     "store.prepared")     /* the next epoch's files exist */ \
    X(STORE_NOTICE,       "store.notice")       /* and its notice */ \
    X(STORE_CARRIED,      "store.carried")      /* the last whole frame is copied into it */ \
    X(STORE_CLAIMED,      "store.claimed")      /* control and notice were sent to the writer */ \
    X(STORE_SLOTS,        "store.slots")        /* a slot was sent to the writer */ \
    X(STORE_READY,        "store.ready")        /* the writer has mapped and sealed one more */ \
    X(STORE_LIVE,         "store.live")         /* all of them: the epoch is the item's */ \
    X(STORE_GRANTED,      "store.granted")      /* the writer was notified that it may begin */ \
    X(STORE_WRITER_LEFT,  "store.writer_left")  /* the item is without a writer */ \
    /* the store: a reader attaches and leaves */ \
    X(STORE_ROOM,         "store.room")         /* slots for another reader exist */ \
    X(STORE_ROOM_TOLD,    "store.room_told")    /* one of them was sent to the writer */ \
    X(STORE_SLOT_TOLD,    "store.slot_told")    /* the writer was notified that readers know it */ \
    X(STORE_ANNOUNCED,    "store.announced")    /* the pin page is queued for the writer */ \
    X(STORE_TAKEN_READER, "store.taken_reader") /* the writer checks its pins */ \
    X(STORE_NOTICED,      "store.noticed")      /* the pin page was sent, and the notice changed */ \
    X(STORE_REGISTERED,   "store.registered")   /* the reader counts */ \
    X(STORE_EPOCH_BEGUN,  "store.epoch_begun")  /* an epoch's control page was sent to a reader, its slots not */ \
    X(STORE_EPOCH,        "store.epoch")        /* a slot was sent to a reader */ \
    X(STORE_ATTACHED,     "store.attached")     /* the reader was notified that it is admitted */ \
    X(STORE_READER_LEFT,  "store.reader_left")  /* it no longer counts, the writer is not notified */ \
    X(STORE_READER_TOLD,  "store.reader_told")  /* the writer was notified */ \
    /* the store: after a restart */ \
    X(STORE_TAKEN,        "store.taken")        /* an offered control page (and notice) is known */ \
    X(STORE_TAKEN_SLOT,   "store.taken_slot")   /* an offered slot is known */ \
    X(STORE_ADOPTED,      "store.adopted")      /* an epoch is adopted */ \
    X(STORE_MERGED,       "store.merged")       /* more of its slots are known */ \
    X(STORE_WRITER_BACK,  "store.writer_back")  /* its writer is back */ \
    X(STORE_READER_BACK,  "store.reader_back")  /* a reader is back */ \
    X(STORE_ACCEPTED,     "store.accepted")     /* the offer was answered */ \
    X(STORE_SETTLED,      "store.settled")      /* clients that have not reported are dead */
/* clang-format on */

#define DDX_POINT_ENUM_(name, text) DDX_AT_##name,
enum ddx_point { DDX_POINTS(DDX_POINT_ENUM_) DDX_POINT_COUNT };
#undef DDX_POINT_ENUM_

#ifdef DDX_FAULTS
#include <stdint.h>

struct ddx_fault_journal {
    _Atomic(uint64_t) passed[DDX_POINT_COUNT];
    _Atomic(int64_t) at[DDX_POINT_COUNT]; /* time of the last pass, CLOCK_MONOTONIC */
    /* the last kill or stop */
    _Atomic(int64_t) time;    /* CLOCK_MONOTONIC */
    _Atomic(uint32_t) struck; /* counts them; written last */
    uint32_t point;
    int32_t pid;
};

extern const char *const ddx_point_name[DDX_POINT_COUNT];
void ddx_fault_pass(enum ddx_point point);
extern int ddx_fault_holder; /* a process that is killed with this one, 0: none */
#define DDX_PASS(name) ddx_fault_pass(DDX_AT_##name)
#else
#define DDX_PASS(name) ((void)0)
#endif

#endif
