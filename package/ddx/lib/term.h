/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Mapping and unmapping the files of an epoch. */
#ifndef DDX_TERM_H
#define DDX_TERM_H

#include "handle.h"

/* Both take ownership of the descriptor, also on failure. */
int ddx_term_new(struct ddx_term **term, uint32_t epoch, const struct ddx_layout *layout, const struct ddx_layout *own,
                 int control_fd, bool writable);
int ddx_term_add_slot(struct ddx_term *term, unsigned slot, int fd);
void ddx_term_free(struct ddx_term *term);

#endif
