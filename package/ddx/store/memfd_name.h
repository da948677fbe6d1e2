/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The names of memory files. A returned name is valid until the next call. */
#ifndef STORE_MEMFD_NAME_H
#define STORE_MEMFD_NAME_H

#include "state.h"

#define MEMFD_NAME_MAX 128
uint64_t memfd_name_digest(const struct ddx_layout *layout);
const char *memfd_name_of(const char *item, const char *what); /* "pin" or "notice" */
const char *memfd_name_of_slot(const char *item, const struct epoch *epoch, unsigned slot); /* DDX_NO_SLOT: control */
bool memfd_name_is(int fd, const char *label); /* and whether a store of this user made the file */

#endif
