/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A value on the network: in CDR as form.h packs it, with three fields before it, as ROS 2 programs expect them.
 *
 *     std_msgs/Header header    wall time of the write; frame_id is the machine's name
 *     uint64 sequence           number of the write in the origin's store
 *     int64 monotonic_ns        time of the write, CLOCK_MONOTONIC of the origin
 *
 * These take a multiple of eight bytes, so the value's fields keep their alignment.
 */
#ifndef DDXCATALOG_ENVELOPE_H
#define DDXCATALOG_ENVELOPE_H

#include <form.h>

#include "description.h"

struct envelope {
    const char *machine;
    uint64_t sequence;
    int64_t wall, monotonic; /* ns */
};

/* Bytes before the fields, CDR's header among them. */
size_t envelope_size(const char *machine);

/* Write them; returns where the fields begin. */
unsigned char *envelope_write(const struct envelope *envelope, unsigned char *message);

/*
 * Read them; returns where the fields of `form` begin, or NULL if the message is none with these fields. `machine` is
 * not set.
 */
const unsigned char *envelope_read(const struct form *form, const unsigned char *message, size_t size,
                                   struct envelope *envelope);

/* What the message with an item's value consists of. 0, -EINVAL, -ENOMEM. As description_parse(). */
int envelope_describe(const struct form *form, struct description **description);

#endif
