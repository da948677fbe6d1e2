/* SPDX-License-Identifier: GPL-2.0-or-later */
/* CRC-32C (Castagnoli), as iSCSI and ext4 have it (RFC 3720, appendix B.4). */
#ifndef DDXVIDEO_CRC32C_H
#define DDXVIDEO_CRC32C_H

#include <stddef.h>
#include <stdint.h>

/* The checksum after `size` more bytes; `crc` is that of the bytes before, 0 at first. */
uint32_t crc32c(uint32_t crc, const void *bytes, size_t size);

#endif
