/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The manifest of an update file: lines NAME=VALUE in this order, each ended by a newline.
 *
 *   board=miniitx      for which board (VARIANT_ID in /etc/os-release)
 *   layout=1           of the disk
 *   version=0.3.0 ...  of the image, for people
 *   serial=1764280000  order of versions: seconds since 1970
 *   size=18874368      bytes of the root file system; a multiple of 512
 *   sha256=...         of each MiB of it, in hexadecimal digits; the last one may be shorter
 */
#ifndef DDXUPDATE_MANIFEST_H
#define DDXUPDATE_MANIFEST_H

#include <stddef.h>
#include <stdint.h>

enum {
    MANIFEST_MAX = 16384, /* bytes of the text */
    MANIFEST_PIECES = 224,
    MANIFEST_HASH = 32,
    MANIFEST_WORD = 128,
    MEBIBYTE = 1 << 20,
};

struct manifest {
    char board[MANIFEST_WORD], version[MANIFEST_WORD];
    uint64_t layout, serial, size;
    unsigned count; /* of pieces */
    uint8_t hashes[MANIFEST_PIECES][MANIFEST_HASH];
};

/* NULL, or the name of the line that is missing or wrong. */
const char *manifest_parse(const char *text, size_t size, struct manifest *manifest);

/* The bytes of a piece: 1 MiB, the last one what is left. */
size_t manifest_piece(const struct manifest *manifest, unsigned index);

#endif
