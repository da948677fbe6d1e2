/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sessions of visitors that have logged in. In memory only: a start of the panel logs all of them out. */
#ifndef DDXPANEL_SESSION_H
#define DDXPANEL_SESSION_H

#include <stddef.h>
#include <stdint.h>

#include "secret.h"

#define SESSIONS 16
#define SESSION_SECONDS (12 * 3600)

struct session {
    unsigned number;            /* for messages; 0: free */
    int64_t end;                /* s */
    char text[SECRET_TEXT + 1]; /* of the cookie */
};

struct sessions {
    struct session session[SESSIONS];
    unsigned last; /* number given last */
};

/*
 * Begin a session at time `now` (s, of a clock that is never set); if all are taken, the oldest one is given up. Its
 * number, from 1 on, with its terminated text for the cookie; -errno.
 */
int session_begin(struct sessions *sessions, int64_t now, char text[SECRET_TEXT + 1]);

/* The number of the session with this text; 0: there is none, or not any more. */
unsigned session_find(const struct sessions *sessions, int64_t now, const char *text, size_t size);

/* Log out. */
void session_end(struct sessions *sessions, unsigned number);

#endif
