/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Messages that ROS 2 brings along, and items whose values are such messages: the item's struct has the fields of the
 * message, after its std_msgs/Header if it has one, under the same names. Messages of fixed size, and Image.
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
 * `type` is "sensor_msgs/msg/Imu". 0; -ENOENT: it is not one of those that are known here; -EINVAL: the values of
 * `form` are none of these, why[] says what differs; -ENOMEM. `form` NULL: it does not matter. To standard_close().
 */
int standard_open(const char *type, const struct form *form, struct standard **standard, char why[STANDARD_WHY]);

/* NULL is allowed. */
void standard_close(struct standard *standard);

/* Bytes of a message at most, but for what DDS pads. */
size_t standard_size(const struct standard *standard, const struct form *form, const char *machine);

/*
 * Write a message; its size, or 0: the item says that this is a picture, and it is none. Of the envelope, `machine` and
 * `wall` are used.
 */
size_t standard_write(const struct standard *standard, const struct form *form, const struct envelope *envelope,
                      const void *value, unsigned char *message);

/* Whether this is a message of the form's values: it has their number of bytes. */
bool standard_check(const struct standard *standard, const struct form *form, const unsigned char *message,
                    size_t size);

/* Read such a message. Padding of the value stays as it is. */
void standard_read(const struct standard *standard, const struct form *form, const unsigned char *message,
                   void *value);

#endif
