/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures to H.264 or MPEG-4 without delay: each picture gives its packet at once. */
#ifndef DDXVIDEO_ENCODER_H
#define DDXVIDEO_ENCODER_H

#include <ddxvideo.h>
#include <libavcodec/avcodec.h>

#include "rtp.h"

struct encoder {
    enum rtp_type type;
    struct ddxvideo_geometry geometry; /* of the pictures that it takes */
    /* private: */
    AVCodecContext *context;
    AVFrame *frame;
    AVPacket *packet;
    int64_t count;
};

/* `bitrate`: bit/s. `room`: bytes of a packet, for MPEG-4's video packets. 0, or a negative AVERROR. */
int encoder_open(struct encoder *encoder, enum rtp_type type, const struct ddxvideo_geometry *geometry, long bitrate,
                 size_t room);
void encoder_close(struct encoder *encoder);

/* The encoded picture; it is the encoder's, until the next call. 0, or a negative AVERROR. */
int encoder_encode(struct encoder *encoder, const struct ddxvideo_picture *view, const AVPacket **packet);

#endif
