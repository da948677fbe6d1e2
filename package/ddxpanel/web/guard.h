/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The checks of a request before its words are looked at, and the sessions of visitors that have logged in. */
#ifndef DDXPANEL_GUARD_H
#define DDXPANEL_GUARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "scgi.h"
#include "secret.h"

/*
 * Whether the header Host names this machine: its host name, that with ".local", localhost, or an address, each with a
 * port or without. Another name may be one of a foreign page that leads here (DNS rebinding). An address cannot: the
 * browser reached the machine by it.
 */
bool guard_host(const char *host, const char *hostname);

/*
 * The status with which a request is answered before anything else: 0 none; 403 the Host is not this machine's, or an
 * order comes from another page; 405 not a method of this path. An order needs POST, the own Origin ("https://" and the
 * Host), and the header X-Panel, which no form of another page can send.
 */
int guard_request(const struct scgi *request, const char *hostname, bool order);

#define SESSIONS 16
#define SESSION_SECONDS (12 * 3600)

struct session {
    unsigned number;            /* for messages; 0: free */
    int64_t end;                /* s */
    char text[SECRET_TEXT + 1]; /* of the cookie */
};

/* In memory only: a start of the panel logs all visitors out. */
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
