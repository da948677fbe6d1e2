/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Checks that a file has exactly the recorded bytes: the first line and each frame match their checksums in the index,
 * and nothing follows the last frame.
 */
#ifndef DDXVIDEO_CHECK_H
#define DDXVIDEO_CHECK_H

#include "index.h"
#include "y4m.h"

struct check {
    const struct index_file *index;
    uint32_t frames;   /* in the index */
    uint64_t position; /* of the next byte */
    uint32_t frame;    /* the current one */
    uint32_t sum;      /* checksum of its bytes so far */
    uint32_t bad;      /* frames that do not match */
    uint32_t first;    /* the first bad frame; `last`: of those that follow it without a gap */
    uint32_t last;
    uint64_t behind;   /* bytes after the last frame */
    uint32_t head;     /* checksum of the bytes before the first frame; `line`: their beginning */
    char line[Y4M_HEADER_MAX];
};

/* Check the next bytes of the file. */
void check_bytes(struct check *check, const unsigned char *bytes, size_t size);

/* At the end of the file: count missing frames as bad. */
void check_end(struct check *check);

/*
 * Whether the first line is as recorded. An index of an older recorder has no checksum of it: then whether it is a Y4M
 * header for pictures of the size in the index.
 */
bool check_head(const struct check *check);

#endif
