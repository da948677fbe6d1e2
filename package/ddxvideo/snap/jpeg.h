/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encodes pictures of the store as JPEG, from their planes: 4:2:0, full range, without RGB in between. */
#ifndef DDXVIDEO_JPEG_H
#define DDXVIDEO_JPEG_H

#include <ddxvideo.h>
#include <picture_convert.h>

struct AVCodecContext;
struct AVFrame;
struct AVPacket;
struct SwsContext;

#define JPEG_BEST 2      /* qualities: larger numbers make smaller files */
#define JPEG_SMALLEST 31 /* the largest that FFmpeg takes */

struct jpeg_form {
    int quality; /* FFmpeg's q, from JPEG_BEST to JPEG_SMALLEST */
    int divisor; /* of width and height: 1 or 2 */
};

/* All 0 at first. */
struct jpeg_encoder {
    /* private: */
    struct as_420 as;
    struct ddxvideo_geometry from; /* of the pictures for which the rest is set up */
    struct jpeg_form form;
    struct SwsContext *scaler; /* NULL: the planes are encoded as they are */
    struct AVCodecContext *codec;
    struct AVFrame *frame;
    struct AVPacket *packet;
};

/*
 * Encode a picture. *bytes belong to the encoder, until the next call. 0, -ENOMEM, -EIO: the encoder refuses it,
 * -ERANGE: it is smaller than 2x2.
 */
int jpeg_encode(struct jpeg_encoder *encoder, const struct ddxvideo_picture *picture, const struct jpeg_form *form,
                const unsigned char **bytes, size_t *size);

void jpeg_close(struct jpeg_encoder *encoder);

#endif
