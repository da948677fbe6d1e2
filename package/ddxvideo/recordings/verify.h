/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_VERIFY_H
#define DDXVIDEO_VERIFY_H

#include <stddef.h>

#include "check.h"
#include "find.h"

/* A file that is read and judged at the same time. */
struct verify {
    int fd, index_fd;
    int hold; /* see found_hold() */
    bool direct;
    uint64_t bytes; /* that are to be read */
    struct index_file *index; /* NULL: it has none */
    bool damaged;             /* not all frames have their sums */
    struct check check;
};

/* Open it, hold it, read its index. 0; -errno after a line. verify_close() in any case. */
int verify_open(struct verify *verify, const struct folder *folder, const struct found *found);
void verify_close(struct verify *verify);

/* Whether the file was given up while it was read: then neither its bytes nor what is wrong with them count. */
bool verify_is_given_up(const struct verify *verify, const struct found *found);

/* All bytes have been seen: say what is wrong, a line each. Whether nothing is. */
bool verify_judge(struct verify *verify, const struct found *found);

/* The next bytes, as bytes_read() gives them; `to` is the struct verify. */
int verify_bytes(void *to, const unsigned char *bytes, size_t size);

/* All of that; a line for a good one as well. Whether it is good. */
bool verify_file(const struct folder *folder, const struct found *found);

#endif
