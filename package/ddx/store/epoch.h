/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The memory files of one term of writing. */
#ifndef STORE_EPOCH_H
#define STORE_EPOCH_H

#include "state.h"

const char *memfd_name_of(const char *item, const char *what);                              /* "pin" or "notice" */
const char *memfd_name_of_slot(const char *item, const struct epoch *epoch, unsigned slot); /* DDX_NO_SLOT: control */
bool memfd_name_is(int fd, const char *label); /* and whether a store of this user made the file */

struct ddx_layout *store_layout(const struct ddx_layout *layout); /* a copy in checkpointed memory; NULL: no memory */

struct epoch *epoch_new(const struct ddx_layout *layout, uint32_t number);
int epoch_create_control(struct epoch *epoch, const char *name);
int epoch_add_slots(struct epoch *epoch, const char *name, unsigned count);
/* How many of `count` slots the worker makes in one turn; the rest follow in later turns, after other clients. */
unsigned epoch_slots_a_turn(const struct epoch *epoch, unsigned count);
/* Number of slots that the epoch has, or will have when it begins. */
unsigned epoch_slots_planned(const struct epoch *epoch);
bool epoch_ready(const struct epoch *epoch);
/* True if a frame was carried over; *sequence: number of the last frame of `from`, if it has one. */
bool epoch_carry_over(struct epoch *from, struct epoch *to, uint64_t *sequence);
void epoch_free(struct epoch *epoch);

#endif
