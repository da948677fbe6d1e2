/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Puts encoded frames together from the packets of one source, in order. */
#ifndef DDXVIDEO_ASSEMBLY_H
#define DDXVIDEO_ASSEMBLY_H

#include "payload.h"
#include "rtp.h"

struct assembly_frame {
    const uint8_t *data; /* valid until the next call; CHUNK_PADDING zero bytes follow */
    size_t size;
    enum rtp_type type;
    bool first;      /* of its source */
    bool incomplete; /* some of its packets are missing */
    bool damaged;    /* incomplete, or packets or frames just before it are missing */
    uint32_t time;   /* RTP's */
    int64_t arrival; /* of its last packet */
    bool has_count;  /* frame.count and .window, which only our sender writes */
    bool has_source; /* frame.capture, .sequence and .number as well */
    bool derived;    /* the first packet, which has these, is missing; they are from derive() */
    struct rtp_frame frame;
    unsigned missing; /* whole frames that were lost between the previous frame and this one */
};

struct assembly {
    struct chunk chunk;
    struct assembly_frame frame; /* the frame that is being put together */
    bool open;                   /* a packet of it has come */
    bool fresh;                  /* no frame of this source has been returned yet */
    uint16_t expected;           /* frame.count of the next frame */
    struct {                     /* the last frame whose first packet came, for frames whose first packet is missing */
        bool there;
        uint32_t time; /* RTP's */
        struct rtp_frame frame;
    } known;
    struct h264_unpacker h264;
    struct mpeg4_unpacker mpeg4;
};

/* A new source. An assembly starts as 0. */
void assembly_begin(struct assembly *assembly);
void assembly_free(struct assembly *assembly);

/* Whether the packet begins another frame while one is open; then the open frame lacks its last packet. */
bool assembly_is_next(const struct assembly *assembly, const struct rtp_packet *packet);

/* Add a packet to the frame; `lost`: packets that are missing before it. False if its payload is malformed. */
bool assembly_add(struct assembly *assembly, const struct rtp_packet *packet, unsigned lost, int64_t arrival);

/* Finish the frame. With `cut` it lacks its last packet, otherwise it is whole. False if none is open. */
bool assembly_close(struct assembly *assembly, bool cut, struct assembly_frame *frame);

/* The lowest number that the next packet's frame can have, for senders that count their frames. */
uint16_t assembly_due(const struct assembly *assembly);

#endif
