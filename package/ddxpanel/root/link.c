/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "link.h"

#include <string.h>

int link_make(struct link *link, int64_t now) {
    explicit_bzero(link, sizeof *link);
    int error = secret_make(link->text);
    if (!error)
        link->end = now + LINK_SECONDS;
    return error;
}

bool link_use(struct link *link, int64_t now, const char *text) {
    bool good = *link->text && now < link->end && secret_is(link->text, text);

    if (good)
        explicit_bzero(link, sizeof *link);
    return good;
}
