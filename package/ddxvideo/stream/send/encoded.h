/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_ENCODED_H
#define DDXVIDEO_ENCODED_H

#include <stddef.h>
#include <stdint.h>

/* An encoded frame: a byte stream. The memory is the encoder's. */
struct encoded {
    const uint8_t *data;
    size_t size;
};

#endif
