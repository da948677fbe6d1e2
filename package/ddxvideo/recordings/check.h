/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Whether a file's bytes are those that were recorded: each frame's against its sum in the index. */
#ifndef DDXVIDEO_CHECK_H
#define DDXVIDEO_CHECK_H

#include "index.h"

struct check {
    const struct index_file *index;
    uint32_t frames;   /* in the index */
    uint64_t position; /* of the next byte */
    uint32_t frame;    /* the present one */
    uint32_t sum;      /* of what there was of it */
    uint32_t bad;      /* frames so far */
    uint32_t first;    /* of these, and the last one of those that follow it without a gap */
    uint32_t last;
};

/* The next bytes of the file. */
void check_bytes(struct check *check, const unsigned char *bytes, size_t size);

/* So many of its frames were not there. */
void check_end(struct check *check);

#endif
