/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Rearranges pixels whose order libswscale cannot read, as IIDC cameras send them. */
#ifndef DDXVIDEO_UNPACK_H
#define DDXVIDEO_UNPACK_H

#include "pixels.h"

/* Bytes of a whole rearranged picture. */
size_t unpack_size(const struct pixels *pixels);

/* Rearrange a whole picture into `to`; sets its planes and strides. */
void unpack_run(const struct pixels *pixels, const unsigned char *from, unsigned char *to, unsigned char *plane[3],
                int stride[3]);

#endif
