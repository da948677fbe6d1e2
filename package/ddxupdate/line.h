/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Texts of lines or words NAME=VALUE. */
#ifndef DDXUPDATE_LINE_H
#define DDXUPDATE_LINE_H

#include <stddef.h>
#include <string.h>

/* The value in a line, up to the end of the text, if it is that of this name; else NULL. */
static inline const char *line_value(const char *line, const char *name) {
    const size_t length = strlen(name);

    return !strncmp(line, name, length) && line[length] == '=' ? line + length + 1 : NULL;
}

#endif
