/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A copy of a picture, which lasts longer than the frame in the store. */
#ifndef DDXVIDEO_PLAY_STILL_H
#define DDXVIDEO_PLAY_STILL_H

#include <ddxvideo.h>
#include <stddef.h>

/* All 0 at first: no picture. */
struct still {
    struct ddxvideo_picture picture; /* its planes are in: */
    unsigned char *bytes;
    size_t size;
};

/* 0, or -ENOMEM: then there is no picture. */
int still_take(struct still *still, const struct ddxvideo_picture *picture);
void still_close(struct still *still);

#endif
