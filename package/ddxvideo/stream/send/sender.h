/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_SENDER_H
#define DDXVIDEO_SENDER_H

#include "announce.h"
#include "counters.h"
#include "encoder.h"
#include "mpeg4.h"
#include "outlet.h"
#include "program.h"
#include "ts.h"

struct sender {
    /* what to do */
    struct program program;
    const char *name; /* of the video item */
    enum rtp_type type;
    long bitrate; /* kbit/s */
    bool fast;    /* preset ultrafast */
    struct outlet outlet;
    struct ts ts;
    struct announce announce;
    const char *sdp; /* file, or folder with a slash at its end, or NULL */
    /* how it stands */
    DDX_STATS_BOOK *book;
    DDX_STORE_ITEM *video;
    struct counters counters;
    uint64_t counts[7];
    struct encoder encoder;
    struct mpeg4_packer mpeg4;
    bool awaited; /* the item was not there when the sender came: all that is written to it is ours to send */
    bool follows; /* what is written now is ours to send */
    bool said_waiting;
    int64_t begin; /* of the wait for the item */
    bool failing;   /* packets do not go out, said so */
    uint16_t sequence;
    uint32_t ssrc, time_offset;
    uint16_t count; /* frames sent */
    int status;
    bool done;
};

/* Send until told to stop; returns the program's exit status. */
int sender_run(struct sender *sender);

#endif
