/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The keys that this image trusts: files in /etc/ddx/update-keys. A key is revoked by leaving it out of an image. */
#ifndef DDXUPDATE_KEYS_H
#define DDXUPDATE_KEYS_H

#include "signature.h"

enum { KEYS_MAX = 32 };

/* Read the keys in this folder; a file that is no key is reported and left out. Returns their number. */
unsigned keys_read(const char *folder, struct update_key keys[KEYS_MAX]);

#endif
