/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The names of memory files. Each is good until the next one is asked for. */
#ifndef STORE_LABEL_H
#define STORE_LABEL_H

#include "state.h"

#define LABEL_MAX 128
uint64_t label_digest(const struct ddx_layout *layout);
const char *label_of(const char *item, const char *what); /* "pin" or "notice" */
const char *label_of_slot(const char *item, const struct epoch *epoch, unsigned slot); /* DDX_NO_SLOT: control */
bool label_is(int fd, const char *label); /* and a store of this user made it */

#endif
