/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "name.h"

#include <string.h>

/* The value of a hexadecimal digit; -1: it is none. */
static int digit(char c) {
    static const char digits[] = "0123456789abcdef0123456789ABCDEF";
    const char *at = c ? strchr(digits, c) : NULL;

    return at ? (int)(at - digits) % 16 : -1;
}

bool name_parse(char *name, size_t room, const char *text, size_t size) {
    size_t length = 0;

    for (const char *at = text; at < text + size; at++) {
        int c = (unsigned char)*at;

        if (c == '%') {
            int high = at + 2 < text + size ? digit(at[1]) : -1, low = high < 0 ? -1 : digit(at[2]);
            if (low < 0)
                return false;
            c = 16 * high + low;
            at += 2;
        }
        if (c <= ' ' || c > '~' || c == '/' || length + 1 >= room)
            return false;
        name[length++] = (char)c;
    }
    name[length] = 0;
    return length > 0;
}
