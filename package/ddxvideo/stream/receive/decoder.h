/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encoded frames to pictures, in one thread: each frame gives its picture at once. */
#ifndef DDXVIDEO_DECODER_H
#define DDXVIDEO_DECODER_H

#include <libavcodec/avcodec.h>
#include <stdbool.h>

#include "rtp.h"

struct decoder {
    AVCodecContext *context; /* NULL: none yet */
    AVFrame *picture, *next;
    AVPacket *packet;
    enum rtp_type type;
    bool joined; /* it has begun at a place where one can begin */
};

/* For a new source. 0, or a negative AVERROR. */
int decoder_open(struct decoder *decoder, enum rtp_type type);
void decoder_close(struct decoder *decoder);

/*
 * The picture of a frame, until the next call; NULL if it gives none. CHUNK_PADDING readable bytes are behind the data.
 * A picture with missing parts is patched up from the ones before; *damaged says so.
 */
const AVFrame *decoder_decode(struct decoder *decoder, const uint8_t *data, size_t size, bool *damaged);

/* Whether a frame brings along what a decoder needs to begin: parameter sets, or a VOL header. */
bool decoder_can_begin(enum rtp_type type, const uint8_t *data, size_t size);

#endif
