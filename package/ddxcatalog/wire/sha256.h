/* SPDX-License-Identifier: GPL-2.0-or-later */
/* SHA-256 (FIPS 180-4) of short texts: ROS 2 distinguishes types by it. */
#ifndef DDXCATALOG_SHA256_H
#define DDXCATALOG_SHA256_H

#include <stddef.h>
#include <stdint.h>

#define SHA256_BYTES 32

void sha256(const void *data, size_t size, uint8_t digest[SHA256_BYTES]);

#endif
