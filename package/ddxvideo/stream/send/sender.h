/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sends a video item as a stream: the settings and the state. */
#ifndef DDXVIDEO_SENDER_H
#define DDXVIDEO_SENDER_H

#include "announce.h"
#include "counters.h"
#include "encoder.h"
#include "picture_convert.h"
#include "post.h"
#include "program.h"
#include "ts.h"

#define SENDER_COUNTS 20

/* The current rate: of the last whole second, and the start of the next one. */
struct sender_rate {
    uint64_t kbit;    /* per second, IP and UDP headers included */
    uint64_t percent; /* repair packets for each 100 media packets */
    uint64_t video;   /* kbit/s of media packets */
    int64_t begin;
    uint64_t bytes, media_bytes, media, repairs;
};

struct sender {
    /* settings: */
    struct program program;
    const char *name; /* of the video item */
    enum rtp_type type;
    long wire;    /* kbit/s of everything that is sent to a receiver, IP and UDP headers included */
    long bitrate; /* kbit/s of encoded video, at most */
    bool repairs; /* repair packets are sent */
    double ratio; /* of repair packets to media packets, where no receiver reports */
    bool fast;    /* preset ultrafast */
    struct outlet outlet;
    struct ts ts;
    struct announce announce;
    const char *sdp;       /* file, or folder with a slash at its end, or NULL */
    const char *key;       /* file, or NULL */
    struct secure *secure; /* its key, or NULL */
    /* state: */
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    struct counters counters;
    uint64_t counts[SENDER_COUNTS];
    struct sender_rate rate;
    struct as_420 as_420;
    struct encoder encoder;
    bool described; /* the description is of this encoder's stream */
    size_t wanted;  /* requested bytes of the last frame */
    struct post post;
    struct outlet sent; /* the outlet's counters at the last check */
    bool awaited;       /* the item did not exist when the sender started: all of its frames count */
    bool follows;       /* frames count from now on */
    bool said_waiting;
    int64_t begin; /* of the wait for the item */
    bool failing;  /* reported that packets are not sent */
    uint32_t ssrc, time_offset;
    uint16_t count; /* frames handed over */
    int status;
    bool done;
};

/* Send until a stop is requested. Returns the exit status. */
int sender_run(struct sender *sender);

#endif
