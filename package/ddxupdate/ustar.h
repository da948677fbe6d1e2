/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Members of an uncompressed archive in POSIX's format `ustar`, as far as an update file has them: regular files. */
#ifndef DDXUPDATE_USTAR_H
#define DDXUPDATE_USTAR_H

#include <stdbool.h>
#include <stdint.h>

enum { USTAR_BLOCK = 512, USTAR_NAME = 101 };

struct ustar_member {
    char name[USTAR_NAME];
    uint64_t size; /* bytes; the contents are padded with zeros to whole blocks */
};

/* Read the block before a member. False if it is not that of a regular file. */
bool ustar_parse(const uint8_t block[USTAR_BLOCK], struct ustar_member *member);

/* Bytes of padding after this number of bytes of contents. */
unsigned ustar_padding(uint64_t size);

#endif
