/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Datagrams to encoded frames: which source is followed, its packets in order, missing packets restored from repair
 * packets. No sockets, no codec, no clock. Nothing that comes in is trusted.
 *
 * Packets after a missing one wait for it. While the sender sends repair packets, they wait as long as the missing one
 * can be restored: until it is further back than the sender's window of frames or than REORDER_PACKETS, or for
 * INTAKE_REPAIR. Without repair they wait for the patience given. Then the missing packet is given up: it is lost.
 *
 * The source (SSRC) heard first is followed. Another one takes its place when it was silent for INTAKE_SILENCE, or had
 * sent a single packet only, and the new one sent two packets that follow each other: a restarted sender is followed,
 * from its first packet on, a second stream on the same port never takes over.
 */
#ifndef DDXVIDEO_INTAKE_H
#define DDXVIDEO_INTAKE_H

#include "assembly.h"
#include "reorder.h"
#include "restore.h"

#define INTAKE_SILENCE INT64_C(400000000) /* ns */
#define INTAKE_REPAIR INT64_C(1000000000) /* ns that a packet waits for a missing one that may be restored */
#define INTAKE_QUEUE 64                   /* kept packets of a possible successor */

/*
 * What happened to the datagrams: received + restored = used + late + duplicate + foreign + garbage (+ those that still
 * wait). Repair packets: repair_received = restored + repair_refused + repair_useless + repair_expired + repair_corrupt
 * (+ those that still wait); see restore.h.
 */
enum intake_count {
    INTAKE_RECEIVED,
    INTAKE_BYTES,
    INTAKE_USED,      /* went into a frame */
    INTAKE_LOST,      /* numbers missing in the count: lost or too late */
    INTAKE_LATE,      /* came after they were given up; they stay counted as lost */
    INTAKE_DUPLICATE, /* came twice */
    INTAKE_REORDERED, /* came after a later packet, but in time; they were used */
    INTAKE_FOREIGN,   /* other payload types, other sources */
    INTAKE_GARBAGE,   /* not RTP, or an invalid payload */
    INTAKE_SOURCES,   /* sources followed so far */
    INTAKE_RESTORED,  /* missing, and restored from repair packets */
    INTAKE_REPAIR_RECEIVED,
    INTAKE_REPAIR_REFUSED,
    INTAKE_REPAIR_USELESS,
    INTAKE_REPAIR_EXPIRED,
    INTAKE_REPAIR_CORRUPT,
    INTAKE_REPAIR_WRONG, /* restored packets that arrived later with other contents */
    INTAKE_COUNTS
};
#define INTAKE_NAMES                                                                                        \
    "received", "bytes", "used", "lost", "late", "duplicate", "reordered", "foreign", "garbage", "sources", \
        "restored", "repair_received", "repair_refused", "repair_useless", "repair_expired", "repair_corrupt", \
        "repair_wrong"

struct intake {
    uint64_t count[INTAKE_COUNTS];
    int64_t patience;
    bool repairs; /* a missing packet is waited for as long as it can be restored */
    /* the source that is followed */
    bool followed, confirmed;
    uint32_t ssrc;
    uint8_t type;
    uint8_t window;  /* frames that its repair packets reach back, 0: it sends none; and its newest frame: */
    uint16_t newest;
    int64_t heard; /* when it was heard last */
    /* a possible successor: its packets since the followed source was heard last */
    uint32_t other;
    bool in_sequence; /* two of its packets follow each other */
    uint16_t other_sequence;
    int64_t other_heard;
    unsigned queued, taken;
    bool replaying; /* after the switch: they are taken one by one */
    /* a datagram that waits until the earlier packets are taken out */
    struct reorder_slot held;
    bool held_restored; /* it was restored */
    bool switching;     /* the same, and then the other source is followed */
    struct assembly assembly;
    uint64_t repaired[RESTORE_COUNTS], wrong; /* counts of `restore` for former sources */
    /* last, since they are large: packets of the source that is followed, and of the other one */
    struct restore restore;
    struct reorder reorder;
    struct reorder_slot queue[INTAKE_QUEUE];
};

/* `patience`: ns that a packet may wait for one before it; `repairs`: longer, if the missing one may be restored. */
void intake_init(struct intake *intake, int64_t patience, bool repairs);
void intake_free(struct intake *intake);

/*
 * A datagram came. Take all frames out before the next one. True if it is a packet of the source that is followed, and
 * neither late nor a duplicate.
 */
bool intake_put(struct intake *intake, const uint8_t *data, size_t size, int64_t now);

/* A datagram came to the port of repair packets. Likewise. True if it is a repair packet of the source followed. */
bool intake_put_repair(struct intake *intake, const uint8_t *data, size_t size);

/* The next frame, if there is one. */
bool intake_take(struct intake *intake, int64_t now, struct assembly_frame *frame);

/* Like intake_take(), at the end: waits for no datagram, and also returns a frame without its last packet. */
bool intake_take_last(struct intake *intake, struct assembly_frame *frame);

/* When intake_take() can return a frame without a new datagram; INT64_MAX if never. */
int64_t intake_deadline(const struct intake *intake);

#endif
