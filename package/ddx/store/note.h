/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the store says to people. */
#ifndef STORE_NOTE_H
#define STORE_NOTE_H

#include <stdbool.h>
#include <stddef.h>

/* A line for people; say() is for a whole text. False: the log is not read, the line was omitted. */
void note(const char *format, ...) __attribute__((format(printf, 1, 2)));
bool say(int fd, const char *text, size_t length);

#endif
