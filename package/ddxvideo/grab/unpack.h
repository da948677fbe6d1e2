/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pixels in an order that libswscale cannot read, as IIDC cameras send them: rearranged in a buffer of our own. */
#ifndef DDXVIDEO_UNPACK_H
#define DDXVIDEO_UNPACK_H

#include "pixels.h"

/* Bytes that a whole picture takes when it is rearranged. */
size_t unpack_size(const struct pixels *pixels);

/* Rearrange a whole picture into `to`, and say where its planes and their strides are. */
void unpack_run(const struct pixels *pixels, const unsigned char *from, unsigned char *to, unsigned char *plane[3],
                int stride[3]);

#endif
