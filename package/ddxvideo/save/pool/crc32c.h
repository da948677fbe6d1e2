/* SPDX-License-Identifier: GPL-2.0-or-later */
/* CRC-32C (Castagnoli), as iSCSI and ext4 have it (RFC 3720, appendix B.4). */
#ifndef DDXVIDEO_CRC32C_H
#define DDXVIDEO_CRC32C_H

#include <stddef.h>
#include <stdint.h>

/* Of `size` more bytes after those that gave `crc`; begins with 0. */
uint32_t crc32c(uint32_t crc, const void *bytes, size_t size);

#endif
