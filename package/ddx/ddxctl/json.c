/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <stdio.h>

#include "ddxctl.h"

void json_string(const char *text, size_t length) {
    putchar('"');
    for (size_t i = 0; i < length && text[i]; i++) {
        unsigned char c = (unsigned char)text[i];

        if (c == '"' || c == '\\')
            printf("\\%c", c);
        else if (c < ' ' || c > 126) /* bytes, not characters: their encoding is unknown */
            printf("\\u%04x", c);
        else
            putchar(c);
    }
    putchar('"');
}

const char *readable_bytes(uint64_t bytes, char text[16]) {
    static const char units[] = " KMGT";
    unsigned unit = 0;
    double value = (double)bytes;

    while (value >= 1024 && units[unit + 1]) {
        value /= 1024;
        unit++;
    }
    if (unit)
        snprintf(text, 16, "%.*f%c", value < 10 ? 1 : 0, value, units[unit]);
    else
        snprintf(text, 16, "%u", (unsigned)bytes);
    return text;
}
