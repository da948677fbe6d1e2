/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A name in the address of a request: of an item, or of a recording's file. */
#ifndef DDXPANEL_NAME_H
#define DDXPANEL_NAME_H

#include <stdbool.h>
#include <stddef.h>

/*
 * Whether the first `size` bytes of `text` are a name with fewer than `room` bytes: visible characters without '/',
 * each as itself or as %XX. If so, writes it with its 0 byte.
 */
bool name_parse(char *name, size_t room, const char *text, size_t size);

#endif
