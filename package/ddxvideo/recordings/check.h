/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Whether a file's bytes are those that were recorded, all of them: the first line and each frame against their sums in
 * the index, and nothing after the last frame.
 */
#ifndef DDXVIDEO_CHECK_H
#define DDXVIDEO_CHECK_H

#include "index.h"
#include "y4m.h"

struct check {
    const struct index_file *index;
    uint32_t frames;   /* in the index */
    uint64_t position; /* of the next byte */
    uint32_t frame;    /* the present one */
    uint32_t sum;      /* of what there was of it */
    uint32_t bad;      /* frames so far */
    uint32_t first;    /* of these, and the last one of those that follow it without a gap */
    uint32_t last;
    uint64_t behind;   /* bytes after the last frame */
    uint32_t head;     /* sum of what was before the first frame, and its beginning */
    char line[Y4M_HEADER_MAX];
};

/* The next bytes of the file. */
void check_bytes(struct check *check, const unsigned char *bytes, size_t size);

/* Number of its missing frames. */
void check_end(struct check *check);

/*
 * Whether the first line is the one that was recorded. An index of an older recorder has no sum of it: then whether it
 * is a line of Y4M whose pictures have the size that the index says.
 */
bool check_head(const struct check *check);

#endif
