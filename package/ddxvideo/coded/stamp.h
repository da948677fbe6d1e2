/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Facts on each frame of a compressed recording, in its H.264 as user data (SEI): players pass over them. */
#ifndef DDXVIDEO_STAMP_H
#define DDXVIDEO_STAMP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "ddxvideo.h"

#define STAMP_MAX 160   /* bytes of a payload */
#define STAMP_PAYLOAD 5 /* its type in H.264: user data with a UUID */
#define STAMP_NAL_MAX 256

struct stamp {
    uint64_t sequence;                           /* in the store */
    int64_t frame;                               /* the source's number, */
    int64_t source_sequence;                     /* and its own count */
    int64_t time;                                /* of the capture, CLOCK_MONOTONIC, ns */
    int64_t wall;                                /* as wall time; 0 if unknown */
    uint32_t lost_store, lost_ring, lost_encode; /* frames lost before this one, by reason */
    bool key;                                    /* only a key frame has: */
    struct ddxvideo_geometry geometry;           /* as in the store */
};

/* Write the payload; its size. */
size_t stamp_write(uint8_t to[STAMP_MAX], const struct stamp *stamp);

/* As a whole NAL unit, with its length of 4 bytes; its size. It goes before the frame's other NAL units. */
size_t stamp_write_nal(uint8_t to[STAMP_NAL_MAX], const struct stamp *stamp);

/* Find the payload in a frame of an MP4 file, whose NAL units have lengths of 4 bytes. False: none, or a bad one. */
bool stamp_read(const uint8_t *frame, size_t size, struct stamp *stamp);

#endif
