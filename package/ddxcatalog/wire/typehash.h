/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ROS 2's hash of a type (REP 2016), with which its tools notice that two programs use different structs. */
#ifndef DDXCATALOG_TYPEHASH_H
#define DDXCATALOG_TYPEHASH_H

#include "description.h"

#define TYPEHASH_MAX 80 /* bytes of "RIHS01_<64 hexadecimal digits>", with the 0 byte */

/* 0, -ENOMEM. */
int typehash(const struct description *description, char text[TYPEHASH_MAX]);

#endif
