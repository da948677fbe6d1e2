/* SPDX-License-Identifier: GPL-2.0-or-later */
/* MPEG-4 part 2 by libavcodec: a key frame every two seconds, and video packets that fit in RTP packets. */
#ifndef DDXVIDEO_ENCODE_MPEG4_H
#define DDXVIDEO_ENCODE_MPEG4_H

#include <ddxvideo.h>
#include <libavcodec/avcodec.h>
#include <stdbool.h>
#include <stdint.h>

#include "encoded.h"

struct encode_mpeg4 {
    AVCodecContext *context; /* NULL: not open */
    AVFrame *frame;
    AVPacket *packet;
};

/* `bitrate`: bit/s. 0, or a negative AVERROR. Close it in any case. */
int encode_mpeg4_open(struct encode_mpeg4 *encoder, const struct ddxvideo_geometry *geometry, int rate_num,
                      int rate_den, long bitrate);
void encode_mpeg4_close(struct encode_mpeg4 *encoder);

/* Like encoder_encode(). `number`: of the picture, from 0. `key`: make it a key frame. */
int encode_mpeg4_picture(struct encode_mpeg4 *encoder, const struct ddxvideo_picture *picture, int64_t number, bool key,
                         size_t wanted, struct encoded *encoded);

#endif
