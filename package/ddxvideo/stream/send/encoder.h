/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encodes pictures as H.264 or MPEG-4 without delay: each picture gives its frame at once. */
#ifndef DDXVIDEO_ENCODER_H
#define DDXVIDEO_ENCODER_H

#include <ddxvideo.h>
#include <libavcodec/avcodec.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <x264.h>

#include "payload.h"
#include "rtp.h"

/* An encoded frame: a byte stream. The memory is the encoder's. */
struct encoded {
    const uint8_t *data;
    size_t size;
};

#define ENCODE_SETS_MAX 256       /* bytes of both parameter sets */
#define ENCODER_RENEWAL_SECONDS 4 /* from one renewal to the next; with one a second pictures are 1.5 dB worse */

struct encode_h264 {
    x264_t *x264; /* NULL: not open */
    x264_param_t param;
    double rate;   /* frames per second */
    double bytes;  /* of a frame, by the bitrate */
    double level;  /* bytes that were wanted lately */
    double buffer; /* frames that the rate control may average over now */
    uint8_t sets[ENCODE_SETS_MAX];
    size_t sets_size;
    int64_t sets_due;   /* number of the next picture with the parameter sets */
    struct chunk chunk; /* a frame with parameter sets */
};

struct encode_mpeg4 {
    AVCodecContext *context; /* NULL: not open */
    AVFrame *frame;
    AVPacket *packet;
};

struct encoder_settings {
    enum rtp_type type;
    long bitrate; /* bit/s */
    bool fast;    /* H.264: preset ultrafast, half the time, for slow processors; superfast is better by 2 dB */
};

struct encoder {
    enum rtp_type type;
    struct ddxvideo_geometry geometry; /* of the input pictures */
    /* private: */
    int64_t count; /* pictures so far */
    bool key;      /* MPEG-4: the next frame will be a key frame */
    struct encode_h264 h264;
    struct encode_mpeg4 mpeg4;
};

/* 0, or a negative AVERROR. Close it in any case. */
int encoder_open(struct encoder *encoder, const struct encoder_settings *settings,
                 const struct ddxvideo_geometry *geometry);
void encoder_close(struct encoder *encoder);

/*
 * Encode two grey pictures and discard them. The first use of an encoder loads its code and builds its tables, for as
 * long as several frames take on a slow processor: before the first frame no frame is lost by that. Failures are left
 * to encoder_open().
 */
void encoder_warm(const struct encoder_settings *settings);
bool encoder_is_open(const struct encoder *encoder);

/*
 * Encode a picture. `wanted`: bytes that the frame should have; 0: by the bitrate. H.264's frames are mostly within 30
 * % of it, and on average slightly smaller; after a rise of `wanted` one more frame is as small as before. MPEG-4's key
 * frames are several times as large; there, the mean over half a second follows `wanted`. The encoded frame is valid
 * until the next call. 0, or a negative AVERROR.
 */
int encoder_encode(struct encoder *encoder, const struct ddxvideo_picture *picture, size_t wanted,
                   struct encoded *encoded);

/*
 * Let receivers begin at one of the next frames. H.264: `whole`: the next frame is a key frame; else the next frames
 * renew the picture column by column (after the current renewal, if there is one), without a frame that looks worse.
 * Nothing else renews H.264's picture, so call it each ENCODER_RENEWAL_SECONDS for receivers that cannot ask; only a
 * picture with more columns of 16 pixels than frames in that time is renewed all the time. MPEG-4's next frame is a key
 * frame; it has regular ones besides.
 */
void encoder_refresh(struct encoder *encoder, bool whole);

#endif
