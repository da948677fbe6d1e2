/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A value on the network: in CDR as form.h packs it, after three fields that ROS 2 programs expect.
 *
 *     std_msgs/Header header    wall time of the write; frame_id is the machine's name
 *     uint64 sequence           number of the write in the origin's store
 *     int64 monotonic_ns        time of the write, CLOCK_MONOTONIC of the origin
 *
 * These fields take a multiple of eight bytes, so the value's fields keep their alignment.
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

/* Write the three fields. Returns where the value's fields begin. */
unsigned char *envelope_write(const struct envelope *envelope, unsigned char *message);

/*
 * Read the three fields. Returns where the fields of `form` begin, or NULL if the message does not have these fields.
 * `machine` is not set.
 */
const unsigned char *envelope_read(const struct form *form, const unsigned char *message, size_t size,
                                   struct envelope *envelope);

/* Describe the message with an item's value. 0, -EINVAL, -ENOMEM. The result as of description_parse(). */
int envelope_describe(const struct form *form, struct description **description);

#endif
