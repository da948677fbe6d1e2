/* SPDX-License-Identifier: GPL-2.0-or-later */
/* JPEG pictures from a camera, decoded by libavcodec. */
#ifndef DDXVIDEO_JPEG_H
#define DDXVIDEO_JPEG_H

#include <libavutil/frame.h>
#include <stddef.h>

struct jpeg;

/* NULL: libavcodec was built without its decoder, or no memory. */
struct jpeg *jpeg_open(void);

/*
 * Decode one picture. 0 and its planes at *frame, until the next call; their format has no letter J: the range is the
 * full one always. -EBADMSG: damaged, or of a kind that is not known here.
 */
int jpeg_decode(struct jpeg *jpeg, const void *data, size_t size, const AVFrame **frame);

/* NULL is allowed. */
void jpeg_close(struct jpeg *jpeg);

#endif
