/* SPDX-License-Identifier: GPL-2.0-or-later */
/* H.264 by x264, each frame one slice. Only the first frame is a key frame; later ones renew columns of macroblocks. */
#ifndef DDXVIDEO_ENCODE_H264_H
#define DDXVIDEO_ENCODE_H264_H

#include <ddxvideo.h>
#include <stdbool.h>
#include <stdint.h>
#include <x264.h>

#include "chunk.h"
#include "encoded.h"

#define ENCODE_SETS_MAX 256 /* bytes of both parameter sets */

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

/* `bitrate`: bit/s; `fast`: preset ultrafast. 0, or a negative AVERROR. Close it in any case. */
int encode_h264_open(struct encode_h264 *encoder, const struct ddxvideo_geometry *geometry, int rate_num, int rate_den,
                     long bitrate, bool fast);
void encode_h264_close(struct encode_h264 *encoder);

/* Like encoder_encode(). `number`: of the picture, from 0. `key`: a key frame. */
int encode_h264_picture(struct encode_h264 *encoder, const struct ddxvideo_picture *picture, int64_t number, bool key,
                        size_t wanted, struct encoded *encoded);

#endif
