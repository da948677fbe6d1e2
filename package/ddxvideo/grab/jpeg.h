/* SPDX-License-Identifier: GPL-2.0-or-later */
/* JPEG pictures from a camera, decoded by libavcodec. */
#ifndef DDXVIDEO_JPEG_H
#define DDXVIDEO_JPEG_H

#include <libavutil/frame.h>
#include <stddef.h>

struct jpeg;

/* NULL: libavcodec has no JPEG decoder, or no memory. */
struct jpeg *jpeg_open(void);

/*
 * Decode a picture. 0, and its planes in *frame until the next call; their format is without the letter J, and the
 * range is always the full one. -EBADMSG: damaged, or of an unsupported kind.
 */
int jpeg_decode(struct jpeg *jpeg, const void *data, size_t size, const AVFrame **frame);

/* NULL is allowed. */
void jpeg_close(struct jpeg *jpeg);

#endif
