/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of a video item as sensor_msgs/msg/Image: grey as mono8 or mono16, all others as rgb8. */
#ifndef DDXCATALOG_PICTURE_H
#define DDXCATALOG_PICTURE_H

#include <form.h>

/* Whether the item has pictures. */
bool picture_is(const struct form *form);

/* Largest number of bytes of a picture, with Image's fields before it. */
size_t picture_size(const struct form *form);

/* The time of capture, ns of wall time; `written` if the item does not have it. */
int64_t picture_time(const struct form *form, const void *value, int64_t written);

/*
 * Write the Image without its header, from message[at] on. Returns the end, or 0 if the value is not a valid picture.
 * Alignment counts from the end of CDR's header.
 */
size_t picture_write(const struct form *form, const void *value, unsigned char *message, size_t at);

#endif
