/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "link.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>

#include "guess.h"

int link_make(struct link *link, int64_t now) {
    unsigned char key[LINK_BYTES];

    explicit_bzero(link, sizeof *link);
    if (getrandom(key, sizeof key, 0) != (ssize_t)sizeof key)
        return -EIO;
    for (size_t i = 0; i < LINK_BYTES; i++)
        snprintf(link->text + 2 * i, 3, "%02x", key[i]);
    link->end = now + LINK_SECONDS;
    return 0;
}

bool link_use(struct link *link, int64_t now, const char *text) {
    bool good = *link->text && now < link->end && guess_same(link->text, text);

    if (good)
        explicit_bzero(link, sizeof *link);
    return good;
}
