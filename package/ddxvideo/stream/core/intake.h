/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Makes encoded frames from datagrams: follows one source, puts its packets in order, and restores missing packets from
 * repair packets. No sockets, no codec, no clock. The input is not trusted.
 *
 * Packets after a missing packet wait for it. While the sender sends repair packets, they wait as long as it can be
 * restored: until it is further back than the sender's window of frames or than REORDER_PACKETS, or for INTAKE_REPAIR.
 * Without repair they wait for `patience`. Then the missing packet is given up, and counts as lost.
 *
 * The source (SSRC) heard first is followed. Another source takes its place if the first one was silent for
 * INTAKE_SILENCE or has sent only one packet, and the new one has sent two consecutive packets. So a restarted sender
 * is followed from its first packet on, and a second stream on the same port never takes over.
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
 * Counts of datagrams: received + restored = used + late + duplicate + foreign + garbage (+ those that still wait).
 * Repair packets: repair_received = restored + repair_refused + repair_useless + repair_expired + repair_corrupt (+
 * those that still wait); see restore.h.
 */
enum intake_count {
    INTAKE_RECEIVED,
    INTAKE_BYTES,
    INTAKE_USED,      /* went into a frame */
    INTAKE_LOST,      /* numbers missing in the count: lost or too late */
    INTAKE_LATE,      /* came after they were given up; still counted as lost */
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
#define INTAKE_NAMES                                                                                           \
    "received", "bytes", "used", "lost", "late", "duplicate", "reordered", "foreign", "garbage", "sources",    \
        "restored", "repair_received", "repair_refused", "repair_useless", "repair_expired", "repair_corrupt", \
        "repair_wrong"

struct intake {
    uint64_t count[INTAKE_COUNTS];
    int64_t patience;
    bool repairs; /* wait for a missing packet as long as it can be restored */
    /* the source that is followed: */
    bool followed, confirmed;
    uint32_t ssrc;
    uint8_t type;
    uint8_t window; /* frames that its repair packets reach back, 0: it sends none; its newest frame: */
    uint16_t newest;
    int64_t heard; /* time of its last packet */
    /* a possible successor: its packets since the followed source was heard last */
    uint32_t other;
    bool in_sequence; /* two of its packets were consecutive */
    uint16_t other_sequence;
    int64_t other_heard;
    unsigned queued, taken;
    bool replaying; /* after the switch: its packets are taken one by one */
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

/* `patience`: ns that a packet waits for a missing one before it; `repairs`: longer if that one may be restored. */
void intake_init(struct intake *intake, int64_t patience, bool repairs);
void intake_free(struct intake *intake);

/*
 * Add a datagram; then take all frames before the next call. True if it is a packet of the followed source, and neither
 * late nor a duplicate.
 */
bool intake_put(struct intake *intake, const uint8_t *data, size_t size, int64_t now);

/* The same for a datagram of the port for repair packets. True if it is a repair packet of the followed source. */
bool intake_put_repair(struct intake *intake, const uint8_t *data, size_t size);

/* The next frame, if there is one. */
bool intake_take(struct intake *intake, int64_t now, struct assembly_frame *frame);

/* Like intake_take(), at the end: does not wait for missing packets, and returns a frame without its last packet as
 * well. */
bool intake_take_last(struct intake *intake, struct assembly_frame *frame);

/* The time at which intake_take() can return a frame without a new datagram; INT64_MAX: never. */
int64_t intake_deadline(const struct intake *intake);

#endif
