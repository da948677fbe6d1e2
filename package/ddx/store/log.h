/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the store says to people. */
#ifndef STORE_LOG_H
#define STORE_LOG_H

#include <stdbool.h>
#include <stddef.h>

/* A line for people; log_text() is for a whole text. False: the log is not read, the line was omitted. */
void log_line(const char *format, ...) __attribute__((format(printf, 1, 2)));
bool log_text(int fd, const char *text, size_t length);

#endif
