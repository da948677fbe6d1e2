/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Datagrams to encoded frames: which source is followed, its packets in order, each frame put together. No sockets, no
 * codec, no clock. Nothing that comes in is trusted.
 *
 * The source (SSRC) heard first is followed. Another one takes its place when it was silent for INTAKE_SILENCE, or had
 * sent a single packet only, and the new one sent two packets that follow each other: a restarted sender is followed,
 * from its first packet on, a second stream on the same port never takes over.
 */
#ifndef DDXVIDEO_INTAKE_H
#define DDXVIDEO_INTAKE_H

#include "chunk.h"
#include "h264.h"
#include "mpeg4.h"
#include "reorder.h"

#define INTAKE_SILENCE INT64_C(400000000) /* ns */
#define INTAKE_QUEUE 64                   /* packets of a possible successor that are kept meanwhile */

/* What happened to the datagrams: received = used + late + duplicate + foreign + garbage (+ those that still wait). */
enum intake_count {
    INTAKE_RECEIVED,
    INTAKE_BYTES,
    INTAKE_USED,      /* went into a frame */
    INTAKE_LOST,      /* never came, or too late: numbers missing in the count */
    INTAKE_LATE,      /* came when their place had been given up; they stay counted as lost */
    INTAKE_DUPLICATE, /* came twice */
    INTAKE_REORDERED, /* came after one that follows them, in time; they were used */
    INTAKE_FOREIGN,   /* other payload types, other sources */
    INTAKE_GARBAGE,   /* no RTP, or a payload that cannot be */
    INTAKE_SOURCES,   /* sources followed so far */
    INTAKE_COUNTS
};
#define INTAKE_NAMES \
    "received", "bytes", "used", "lost", "late", "duplicate", "reordered", "foreign", "garbage", "sources"

struct intake_frame {
    const uint8_t *data; /* valid until the next call; CHUNK_PADDING zero bytes behind it */
    size_t size;
    enum rtp_type type;
    bool first;      /* of its source */
    bool damaged;    /* packets are missing in it, or just before it */
    uint32_t time;   /* RTP's */
    int64_t arrival; /* of its last packet */
    bool has_count;  /* frame.count and .window: the sender is one of ours */
    bool has_source; /* frame.capture, .sequence and .number as well */
    bool derived;    /* these are not from the frame's first packet, which is missing; see derive() */
    struct rtp_frame frame;
    unsigned missing; /* whole frames between the one before and this one that never came */
};

struct intake {
    uint64_t count[INTAKE_COUNTS];
    int64_t patience;
    /* the source that is followed */
    bool followed, confirmed;
    uint32_t ssrc;
    uint8_t type;
    int64_t heard; /* when it was heard last */
    /* another one that may become it: what it said since the source that is followed was heard last */
    uint32_t other;
    bool in_sequence; /* two of its packets follow each other */
    uint16_t other_sequence;
    int64_t other_heard;
    unsigned queued, taken;
    bool replaying; /* after the switch: they are taken one by one */
    /* a datagram that has to wait until what is there was taken out */
    struct reorder_slot held;
    bool switching; /* the same, and then the other source is followed */
    /* the frame that is put together */
    struct chunk chunk;
    struct intake_frame frame;
    bool open;         /* a packet of it has come */
    bool fresh;        /* no frame of this source was given out yet */
    uint16_t expected; /* frame.count of the next frame */
    struct {           /* the last frame whose first packet came, for those whose first packet is missing */
        bool there;
        uint32_t time; /* RTP's */
        struct rtp_frame frame;
    } known;
    struct h264_unpacker h264;
    struct mpeg4_unpacker mpeg4;
    /* last, since they are large: packets of the source that is followed, and of the other one */
    struct reorder reorder;
    struct reorder_slot queue[INTAKE_QUEUE];
};

/* `patience`: ns that a packet may wait for one before it. */
void intake_init(struct intake *intake, int64_t patience);
void intake_free(struct intake *intake);

/* A datagram came. Take all frames out before the next one. */
void intake_put(struct intake *intake, const uint8_t *data, size_t size, int64_t now);

/* The next frame, as far as there is one. */
bool intake_take(struct intake *intake, int64_t now, struct intake_frame *frame);

/* As intake_take(), when no datagram comes any more: none is waited for, and a frame without its end is given, too. */
bool intake_take_last(struct intake *intake, struct intake_frame *frame);

/* When intake_take() may give a frame though no datagram comes; INT64_MAX if never. */
int64_t intake_deadline(const struct intake *intake);

#endif
