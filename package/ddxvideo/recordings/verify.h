/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_VERIFY_H
#define DDXVIDEO_VERIFY_H

#include <stddef.h>

#include "find.h"
#include "index.h"
#include "mp4_write.h"
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
    uint64_t behind; /* bytes after the last frame */
    uint32_t tail;   /* their checksum */
    uint32_t head;   /* checksum of the bytes before the first frame; `begin`: their beginning */
    unsigned char begin[MP4_BLOCK];
};

/* A file that is verified while it is read. */
struct verify {
    struct found_use use;
    uint64_t bytes;           /* to be read */
    struct index_file *index; /* NULL: none */
    bool damaged;             /* some frames have no checksum */
    struct check check;
};

/* Open the file, hold it, and read its index. 0; -errno after a line. Call verify_close() in any case. */
int verify_open(struct verify *verify, const struct folder *folder, const struct found *found);
void verify_close(struct verify *verify);

/* After all bytes: print a line for each error. True if there is none. */
bool verify_judge(struct verify *verify, const struct found *found);

/* Take the next bytes, as called by bytes_read(); `to` is the struct verify. */
int verify_bytes(void *to, const unsigned char *bytes, size_t size);

/* Verify a whole file, and print a line also if it is good. True if it is. */
bool verify_file(const struct folder *folder, const struct found *found);

#endif
