/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Every state transition of the protocol, numbered and named, so that a test can end or stop a program at each one.
 *
 * Only a build with DDX_FAULTS (the tests' own copies of library and store) has code at these points. There a program
 * looks at the environment:
 *
 *     DDX_FAULT=writer.published:3:kill[,...]    the third time it passes this point it is killed
 *
 * Also `stop` (SIGSTOP); `end`: the whole store, its holder, too, where a kill is its worker's end alone; `die`, an end
 * that the journal does not mention; and `slow`: 20 ms each time from then on, to hold a race open. DDX_FAULT_JOURNAL
 * names a file of struct ddx_fault_journal that counts the passes of each point, for all programs together.
 */
#ifndef DDX_FAULT_H
#define DDX_FAULT_H

/* clang-format off */
#define DDX_POINTS(X) \
    /* the frame path of the writer: ring.h has the steps */ \
    X(WRITER_CHOSEN,      "writer.chosen")      /* W1: a slot that is neither newest nor pinned */ \
    X(WRITER_MARKED,      "writer.marked")      /* W2: its generation is WRITING */ \
    X(WRITER_NEWS,        "writer.news")        /* W3: readers were added, mark undone */ \
    X(WRITER_UNCHANGED,   "writer.unchanged")   /* W3: they were not */ \
    X(WRITER_COLLIDED,    "writer.collided")    /* W4: a reader pinned it meanwhile, mark undone */ \
    X(WRITER_OWNS,        "writer.owns")        /* W4: no reader did */ \
    X(WRITER_WRITTEN,     "writer.written")     /* W5: the data is there */ \
    X(WRITER_NUMBERED,    "writer.numbered")    /* W5: and its number and time */ \
    X(WRITER_WHOLE,       "writer.whole")       /* W6: its generation is even */ \
    X(WRITER_PUBLISHED,   "writer.published")   /* W7: it is the newest */ \
    X(WRITER_WOKE,        "writer.woke")        /* W7: and all readers know */ \
    X(WRITER_CANCELLED,   "writer.cancelled")   /* instead of W5: the slot is empty */ \
    /* a writer's term begins, changes, ends */ \
    X(CLAIM_SENT,         "claim.sent")         /* asked the store for the role */ \
    X(CLAIM_CONTROL,      "claim.control")      /* control page mapped and sealed, notice mapped */ \
    X(CLAIM_SLOT,         "claim.slot")         /* a slot mapped and sealed, not reported to the store */ \
    X(CLAIM_READY,        "claim.ready")        /* reported to the store */ \
    X(CLAIM_READER,       "claim.reader")       /* a reader's pin page is in the list */ \
    X(CLAIM_TAKEN,        "claim.taken")        /* and the store told so */ \
    X(CLAIM_READER_GONE,  "claim.reader_gone")  /* and out of it again */ \
    X(CLAIM_GRANTED,      "claim.granted")      /* the readers were told: frames may be written */ \
    X(CLAIM_ENDED,        "claim.ended")        /* unmapped, the store not told */ \
    /* the frame path of a reader */ \
    X(READER_CHOSEN,      "reader.chosen")      /* R1: a slot to look at */ \
    X(READER_PINNED,      "reader.pinned")      /* R2: said so in the pin page */ \
    X(READER_OVERTAKEN,   "reader.overtaken")   /* R3: too late, unpinned */ \
    X(READER_HOLDS,       "reader.holds")       /* R3: the frame cannot change any more */ \
    X(READER_COUNTED,     "reader.counted")     /* what was missed is known */ \
    X(READER_COPIED,      "reader.copied")      /* R4: the caller has a copy */ \
    X(READER_RELEASED,    "reader.released")    /* R5: unpinned */ \
    X(READER_WAITS,       "reader.waits")       /* nothing new: about to sleep */ \
    X(READER_UNMAPPED,    "reader.unmapped")    /* the frame is in a slot that was not announced yet */ \
    X(DIRECT_TAKEN,       "direct.taken")       /* R3 for the stable pointer: the former frame is still shown */ \
    X(DIRECT_WITHDRAWN,   "direct.withdrawn")   /* the former frame's pages are home */ \
    X(DIRECT_PREPARED,    "direct.prepared")    /* the pages of a frame that may come are in the window */ \
    X(DIRECT_RESTORED,    "direct.restored")    /* none came: the former one's are */ \
    X(DIRECT_SHOWN,       "direct.shown")       /* the new frame's pages are in the window */ \
    /* a reader comes and goes */ \
    X(ATTACH_SENT,        "attach.sent")        /* asked the store for a reader's share */ \
    X(ATTACH_EPOCH,       "attach.epoch")       /* control page of an epoch mapped */ \
    X(ATTACH_SLOT,        "attach.slot")        /* one of its slots mapped */ \
    X(ATTACH_PAGE,        "attach.page")        /* pin page mapped */ \
    X(ATTACH_BOTH,        "attach.both")        /* memory for both pins at once */ \
    X(ATTACH_FOLLOWED,    "attach.followed")    /* went over to the next epoch */ \
    X(ATTACH_ENDED,       "attach.ended")       /* unmapped, the store not told */ \
    /* the thread that listens to the store, and what it does when the store comes back */ \
    X(KEEPER_HEARD,       "keeper.heard")       /* something is to be read */ \
    X(KEEPER_LOST,        "keeper.lost")        /* the store hung up */ \
    X(KEEPER_FOUND,       "keeper.found")       /* connected to its successor */ \
    X(KEEPER_OFFERED,     "keeper.offered")     /* control page (and notice) sent */ \
    X(KEEPER_SLOT,        "keeper.slot")        /* a slot sent */ \
    X(KEEPER_PIN,         "keeper.pin")         /* pin page sent */ \
    X(KEEPER_END,         "keeper.end")         /* all sent */ \
    X(KEEPER_ACCEPTED,    "keeper.accepted")    /* the store took it */ \
    X(KEEPER_SUPERSEDED,  "keeper.superseded")  /* it did not: another writer was let in */ \
    /* the store: items and clients */ \
    X(STORE_LISTENS,      "store.listens")      /* others can connect */ \
    X(STORE_CLIENT,       "store.client")       /* a client did */ \
    X(STORE_GONE,         "store.gone")         /* a client left or died, nothing given back yet */ \
    X(STORE_ITEM,         "store.item")         /* a new item in the list */ \
    X(STORE_OPENED,       "store.opened")       /* a handle counts, its program not told */ \
    X(STORE_DROPPED,      "store.dropped")      /* an item out of the list */ \
    X(STORE_HANDLED,      "store.handled")      /* a request was handled, nothing of it is committed */ \
    X(STORE_COMMITTED,    "store.committed")    /* it is, and the request is still there */ \
    X(STORE_DISCARDED,    "store.discarded")    /* taken off, no reply sent */ \
    X(STORE_SAID,         "store.said")         /* sent, and that is not committed */ \
    /* the store: a change of writer */ \
    X(STORE_PREPARED,     "store.prepared")     /* the next epoch's files exist */ \
    X(STORE_NOTICE,       "store.notice")       /* and its notice */ \
    X(STORE_CARRIED,      "store.carried")      /* the last whole frame is copied into it */ \
    X(STORE_CLAIMED,      "store.claimed")      /* control and notice were sent to the writer */ \
    X(STORE_SLOTS,        "store.slots")        /* a slot was */ \
    X(STORE_READY,        "store.ready")        /* the writer has mapped and sealed one more */ \
    X(STORE_LIVE,         "store.live")         /* all of them: the epoch is the item's */ \
    X(STORE_GRANTED,      "store.granted")      /* the writer was told that it may begin */ \
    X(STORE_WRITER_LEFT,  "store.writer_left")  /* the item is without a writer */ \
    /* the store: a reader comes and goes */ \
    X(STORE_ROOM,         "store.room")         /* slots for one reader more exist */ \
    X(STORE_ROOM_TOLD,    "store.room_told")    /* one of them was sent to the writer */ \
    X(STORE_SLOT_TOLD,    "store.slot_told")    /* the writer was told that readers know it */ \
    X(STORE_ANNOUNCED,    "store.announced")    /* the pin page is to be sent to the writer */ \
    X(STORE_TAKEN_READER, "store.taken_reader") /* the writer looks at its pins */ \
    X(STORE_NOTICED,      "store.noticed")      /* it was, and the notice says so */ \
    X(STORE_REGISTERED,   "store.registered")   /* the reader counts */ \
    X(STORE_EPOCH_BEGUN,  "store.epoch_begun")  /* an epoch's control page was sent to a reader, its slots not */ \
    X(STORE_EPOCH,        "store.epoch")        /* a slot was sent to a reader */ \
    X(STORE_ATTACHED,     "store.attached")     /* the reader was told that it is in */ \
    X(STORE_READER_LEFT,  "store.reader_left")  /* it counts no more, the writer not told */ \
    X(STORE_READER_TOLD,  "store.reader_told")  /* the writer was told */ \
    /* the store: after a restart */ \
    X(STORE_TAKEN,        "store.taken")        /* an offered control page (and notice) is known */ \
    X(STORE_TAKEN_SLOT,   "store.taken_slot")   /* an offered slot */ \
    X(STORE_ADOPTED,      "store.adopted")      /* an epoch is back */ \
    X(STORE_MERGED,       "store.merged")       /* more of its slots */ \
    X(STORE_WRITER_BACK,  "store.writer_back")  /* its writer is */ \
    X(STORE_READER_BACK,  "store.reader_back")  /* a reader is */ \
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
extern int ddx_fault_holder; /* the process that ends with this one, 0: none */
#define DDX_PASS(name) ddx_fault_pass(DDX_AT_##name)
#else
#define DDX_PASS(name) ((void)0)
#endif

#endif
