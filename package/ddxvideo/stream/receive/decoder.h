/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Decodes frames in one thread: each frame gives its picture at once. */
#ifndef DDXVIDEO_DECODER_H
#define DDXVIDEO_DECODER_H

#include <libavcodec/avcodec.h>
#include <libavutil/frame.h>
#include <stdbool.h>

#include "rtp.h"

struct picture_converter;

struct frame_420 {
    /* private: */
    struct picture_converter *converter;
    int format, width, height; /* of the pictures that it is for */
    AVFrame *frame;            /* the newest one that was converted */
};

/* Larger pictures and other formats are refused before memory is taken, so the network cannot exhaust the memory. */
struct decoder_limits {
    int64_t pixels; /* of a picture */
    bool even;      /* both sides must be even */
};

/* Why the stream cannot be shown. */
enum decoder_refusal {
    DECODER_SHOWS,
    DECODER_SIZE,   /* more pixels than the limit */
    DECODER_FRAMES, /* too many or too large reference frames: several times the limit */
    DECODER_ODD,    /* a width or height that is not even */
    DECODER_FORMAT, /* not 8 bits a sample, or RGB */
};

struct decoder {
    AVCodecContext *context; /* NULL: none yet */
    AVFrame *picture, *next;
    AVPacket *packet;
    struct frame_420 converted;
    enum rtp_type type;
    bool joined;     /* it has begun to decode */
    bool recovering; /* no whole picture since decoder_open() or decoder_lose() */
    bool wanting;    /* the sender should renew the picture */
    unsigned frames; /* while it recovers, since a renewal began */
    struct decoder_limits limits;
    enum decoder_refusal refusal; /* reason of the last refusal */
    int width, height;            /* of the refused pictures */
};

/* For a new source. 0, or a negative AVERROR. */
int decoder_open(struct decoder *decoder, enum rtp_type type, const struct decoder_limits *limits);
void decoder_close(struct decoder *decoder);

/*
 * The picture of a frame in 8-bit 4:2:0, until the next call; NULL if it gives none. CHUNK_PADDING readable bytes are
 * after the data. Missing parts of a picture are filled from former pictures; then *damaged is true. A stream that
 * cannot be shown gives no picture, and decoder->refusal has the reason, until it, or another stream of the same
 * source, can be shown.
 */
const AVFrame *decoder_decode(struct decoder *decoder, const uint8_t *data, size_t size, bool *damaged);

/*
 * Call it if frames before the next one are missing, and pictures that refer to them are not wanted. No picture is
 * given until one is whole again: with H.264 at the end of a renewal (a recovery point) or at an IDR picture, with
 * MPEG-4 at the next key frame. Request a renewal from the sender as long as decoder_wants_renewal() is true.
 */
void decoder_lose(struct decoder *decoder);
bool decoder_wants_renewal(const struct decoder *decoder);

/* Continue with damaged pictures, but request a renewal. */
void decoder_want_renewal(struct decoder *decoder);

#endif
