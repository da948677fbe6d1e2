/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The store's log. */
#ifndef STORE_LOG_H
#define STORE_LOG_H

#include <stdbool.h>
#include <stddef.h>

/* Write a line; log_text() writes a prepared text. Never waits: false if the log is full and the text was dropped. */
void log_line(const char *format, ...) __attribute__((format(printf, 1, 2)));
bool log_text(int fd, const char *text, size_t length);

#endif
