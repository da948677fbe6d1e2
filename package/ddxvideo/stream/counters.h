/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Counters of packets: a store item `<instance>.packets`, a struct with a uint64_t for each name. */
#ifndef DDXVIDEO_COUNTERS_H
#define DDXVIDEO_COUNTERS_H

#include <ddx.h>
#include <stdio.h>

struct counters {
    const char *instance;
    const char *const *names;
    const uint64_t *values; /* the owner's, one for each name */
    unsigned count;
    DDX_STORE_ITEM *item; /* NULL without a store */
};

/* Publish the values; `id` may be NULL. If the store refuses the item, they are only printed, after a line. */
void counters_open(struct counters *counters, DDX_STORE_ID *id);

/* Write the values into the store. */
void counters_write(struct counters *counters);

/* {"instance":"ddxdecode.packets","received":500,...} and a line feed. */
void counters_print(const struct counters *counters, FILE *file);

void counters_close(struct counters *counters);

#endif
