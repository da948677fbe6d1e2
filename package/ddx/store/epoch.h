/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The memory files of one term of writing. */
#ifndef STORE_EPOCH_H
#define STORE_EPOCH_H

#include "state.h"

struct ddx_layout *store_layout(const struct ddx_layout *layout); /* a copy that is kept; NULL: no memory */

struct epoch *epoch_new(const struct ddx_layout *layout, uint32_t number);
int epoch_create_control(struct epoch *epoch, const char *name);
int epoch_add_slots(struct epoch *epoch, const char *name, unsigned count);
/* How many of `count` slots are made in one turn of the worker; the others wait, since other clients must not. */
unsigned epoch_slots_a_turn(const struct epoch *epoch, unsigned count);
/* Slots that there are, or will be before it begins. */
unsigned epoch_slots_planned(const struct epoch *epoch);
bool epoch_ready(const struct epoch *epoch);
/* True if a frame was carried over; *sequence is the number with which `from` ends, if it has any. */
bool epoch_carry_over(struct epoch *from, struct epoch *to, uint64_t *sequence);
void epoch_free(struct epoch *epoch);

#endif
