/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ROS 2's hash of a type (REP 2016), with which its tools notice that two programs use different structs. */
#ifndef DDXCATALOG_TYPEHASH_H
#define DDXCATALOG_TYPEHASH_H

#include <stddef.h>
#include <stdint.h>

#include "description.h"

#define TYPEHASH_MAX 80 /* bytes of "RIHS01_<64 hexadecimal digits>", with the 0 byte */

/* 0, -ENOMEM. */
int typehash(const struct description *description, char text[TYPEHASH_MAX]);

#define SHA256_BYTES 32

/* SHA-256 (FIPS 180-4) of a short text. */
void sha256(const void *data, size_t size, uint8_t digest[SHA256_BYTES]);

#endif
