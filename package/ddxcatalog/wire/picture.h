/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of a video item as sensor_msgs/msg/Image: mono8 and mono16 as they are, all others as rgb8. */
#ifndef DDXCATALOG_PICTURE_H
#define DDXCATALOG_PICTURE_H

#include <form.h>

/* Whether the item has pictures. */
bool picture_is(const struct form *form);

/* Bytes of a picture at most, with what Image has before them. */
size_t picture_size(const struct form *form);

/* When the picture was captured, ns of wall time; `written` if the item does not say. */
int64_t picture_time(const struct form *form, const void *value, int64_t written);

/*
 * Write what follows the header of the Image, from message[at] on; the end, or 0: this is no picture. Alignment is
 * counted from behind CDR's header.
 */
size_t picture_write(const struct form *form, const void *value, unsigned char *message, size_t at);

#endif
