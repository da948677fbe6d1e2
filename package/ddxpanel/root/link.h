/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Links with which a visitor logs in once, for machines whose ddx.txt has no passphrase. `ddxpanel -login` leaves one
 * in a file of root's, from which the process of root takes it.
 */
#ifndef DDXPANEL_LINK_H
#define DDXPANEL_LINK_H

#include <stdbool.h>
#include <stdint.h>

#include "secret.h"

#define LINK_SECONDS 120

/* The one link that counts: a new one makes the former one invalid. */
struct link {
    int64_t end;                /* s */
    char text[SECRET_TEXT + 1]; /* empty: there is none */
};

/* Make a link at time `now` (s, of a clock that is never set). 0 or -errno. */
int link_make(struct link *link, int64_t now);

/* Whether the text is that of the link, in time. It is then used up. */
bool link_use(struct link *link, int64_t now, const char *text);

/* Leave the link in a file that only root can read, in place of a former one. 0 or -errno. */
int link_leave(const struct link *link, const char *path);

/* As link_use(), with the link that was left in the file; the file is then gone. */
bool link_take(const char *path, int64_t now, const char *text);

#endif
