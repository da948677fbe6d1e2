/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Standard messages of ROS 2, and items with such values: the item's struct has the message's fields after its
 * std_msgs/Header (if it has one), with the same names. Supported are messages of fixed size, and Image.
 */
#ifndef DDXCATALOG_STANDARD_H
#define DDXCATALOG_STANDARD_H

#include "envelope.h"

#define STANDARD_WHY 240

struct standard {
    struct description *description;
    bool has_header;
    bool is_picture; /* sensor_msgs/msg/Image of a video item */
};

/*
 * `type` is "sensor_msgs/msg/Imu", for example. 0; -ENOENT: not in the list; -EINVAL: the values of `form` have other
 * fields, and why[] names the difference; -ENOMEM. `form` NULL: not compared. The caller's, until standard_close().
 */
int standard_open(const char *type, const struct form *form, struct standard **standard, char why[STANDARD_WHY]);

/* NULL is allowed. */
void standard_close(struct standard *standard);

/* Largest number of bytes of a message, without DDS's padding. */
size_t standard_size(const struct standard *standard, const struct form *form, const char *machine);

/*
 * Write a message. Returns its size, or 0 if the value of a video item is not a valid picture. Of the envelope,
 * `machine` and `wall` are used.
 */
size_t standard_write(const struct standard *standard, const struct form *form, const struct envelope *envelope,
                      const void *value, unsigned char *message);

/* Whether the message can hold the form's values, by its number of bytes. */
bool standard_check(const struct standard *standard, const struct form *form, const unsigned char *message,
                    size_t size);

/* Read a checked message. Padding of the value stays unchanged. */
void standard_read(const struct standard *standard, const struct form *form, const unsigned char *message, void *value);

#endif
