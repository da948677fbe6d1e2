/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Makes encoded frames from datagrams: follows one source, puts its packets in order, and restores missing packets from
 * repair packets. Makes the reports on them for the sender (reporter.h). No sockets, no codec, no clock. The input is
 * not trusted.
 *
 * Packets after a missing packet wait for it. While the sender sends repair packets, they wait as long as it can be
 * restored: until it is further back than the sender's window of frames or than REORDER_PACKETS, or for
 * STREAM_RX_REPAIR_NS. Without repair they wait for `patience`. Then the missing packet is given up: it is lost.
 *
 * The source (SSRC) heard first is followed. Another source takes its place if the first one was silent for
 * STREAM_RX_SILENCE_NS or has sent only one packet, and the new one has sent two consecutive packets. So a restarted
 * sender is followed from its first packet on, and a second stream on the same port never takes over.
 */
#ifndef DDXVIDEO_STREAM_RX_H
#define DDXVIDEO_STREAM_RX_H

#include "assembly.h"
#include "reporter.h"
#include "rtp.h"

#define REORDER_PACKETS 256 /* as many as repair packets reach back */
#define REORDER_JUMP 1000   /* numbers further away than this are accepted after two consecutive ones */
#define REORDER_MEMORY 1024 /* numbers back, within which duplicates and late packets are told apart */

struct reorder_slot {
    bool used;
    int64_t arrival;
};

struct reorder {
    bool begun;
    uint16_t next;        /* the sequence number that is due */
    unsigned lost_before; /* packets given up before that one, not reported yet */
    struct rtp_stranger stranger;
    unsigned waiting;
    uint8_t seen[REORDER_MEMORY / 8];          /* of the numbers before `next`: whether they came */
    struct reorder_slot slot[REORDER_PACKETS]; /* by sequence number */
};

enum reorder_result {
    REORDER_TAKEN,
    REORDER_OUT_OF_TURN, /* taken; a later one came before it */
    REORDER_DUPLICATE,
    REORDER_LATE, /* it was given up, or its number is far away */
    REORDER_FULL  /* no place: give up a missing packet or take one out, then try again */
};

#define STREAM_RX_SILENCE_NS INT64_C(400000000)
#define STREAM_RX_REPAIR_NS INT64_C(1000000000) /* that a packet waits for a missing one that may be restored */
#define STREAM_RX_QUEUE 64                      /* kept packets of a possible successor */

/*
 * Counts of datagrams: received + restored = used + late + duplicate + foreign + garbage (+ those that still wait).
 * Repair packets: repair_received = restored + repair_refused + repair_useless + repair_expired + repair_corrupt (+
 * those that still wait); see restore.h.
 */
enum stream_rx_count {
    STREAM_RX_RECEIVED,
    STREAM_RX_BYTES,
    STREAM_RX_USED,      /* went into a frame */
    STREAM_RX_LOST,      /* numbers missing in the count: lost or too late */
    STREAM_RX_LATE,      /* came after they were given up; still counted as lost */
    STREAM_RX_DUPLICATE, /* came twice */
    STREAM_RX_REORDERED, /* came after a later packet, but in time; they were used */
    STREAM_RX_FOREIGN,   /* other payload types, other sources */
    STREAM_RX_GARBAGE,   /* not RTP, or an invalid payload */
    STREAM_RX_SOURCES,   /* sources followed so far */
    STREAM_RX_RESTORED,  /* missing, and restored from repair packets */
    STREAM_RX_REPAIR_RECEIVED,
    STREAM_RX_REPAIR_REFUSED,
    STREAM_RX_REPAIR_USELESS,
    STREAM_RX_REPAIR_EXPIRED,
    STREAM_RX_REPAIR_CORRUPT,
    STREAM_RX_REPAIR_WRONG, /* restored packets that arrived later with other contents */
    STREAM_RX_COUNTS
};
#define STREAM_RX_NAMES                                                                                        \
    "received", "bytes", "used", "lost", "late", "duplicate", "reordered", "foreign", "garbage", "sources",    \
        "restored", "repair_received", "repair_refused", "repair_useless", "repair_expired", "repair_corrupt", \
        "repair_wrong"

struct stream_rx_settings {
    int64_t patience; /* ns that a packet waits for a missing one before it */
    bool repairs;     /* wait longer for a missing packet, as long as it can be restored */
    bool reports;     /* make reports */
    uint32_t ssrc;    /* of this receiver, in reports, at random */
};

struct stream_rx {
    uint64_t count[STREAM_RX_COUNTS];
    struct stream_rx_settings settings;
    size_t
        report_header; /* bytes that a report grows by: IP and UDP headers, encryption; set it for each packet's way */
    bool answers;      /* the source is our sender's, which reads reports: */
    struct reporter reporter;
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
    /* a datagram of each port that waits until the earlier packets are taken out */
    struct kept_datagram held, held_repair;
    bool switching; /* the same, and then the other source is followed */
    struct assembly assembly;
    uint64_t repaired[RESTORE_COUNTS], wrong; /* counts of `restore` for former sources */
    /* last, since they are large: packets of the source that is followed, and of the other one */
    struct restore restore;
    struct reorder reorder;
    struct kept_datagram queue[STREAM_RX_QUEUE];
};

void stream_rx_init(struct stream_rx *rx, const struct stream_rx_settings *settings);
void stream_rx_free(struct stream_rx *rx);

/*
 * Add a datagram; then take all frames before the next call. True if it is a packet of the followed source, and neither
 * late nor a duplicate.
 */
bool stream_rx_put(struct stream_rx *rx, const uint8_t *data, size_t size, int64_t now);

/* The same for a datagram of the port for repair packets. True if it is a repair packet of the followed source. */
bool stream_rx_put_repair(struct stream_rx *rx, const uint8_t *data, size_t size, int64_t now);

/* The next frame, if there is one. */
bool stream_rx_take(struct stream_rx *rx, int64_t now, struct assembly_frame *frame);

/* Like stream_rx_take(), at the end: does not wait for missing packets, and returns a frame without its last packet as
 * well. */
bool stream_rx_take_last(struct stream_rx *rx, struct assembly_frame *frame);

/* The time at which stream_rx_take() can return a frame without a new datagram; INT64_MAX: never. */
int64_t stream_rx_deadline(const struct stream_rx *rx);

/*
 * Write the report that is due to to[REPORT_MAX], for the address from which the followed source's packets come.
 * `refresh`: also request a renewal of the picture. Returns its size; 0: none is due.
 */
size_t stream_rx_report(struct stream_rx *rx, int64_t now, bool refresh, uint8_t *to);

/* The time at which a report is due without a new packet; INT64_MAX: never. */
int64_t stream_rx_report_deadline(const struct stream_rx *rx);

#endif
