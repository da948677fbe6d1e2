/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Logging in: by the passphrase, and by a link. */
#ifndef DDXPANEL_LOGIN_H
#define DDXPANEL_LOGIN_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>

#include "secret.h"

#define GUESS_ADDRESSES 2048

/*
 * Limits guesses of the passphrase: a wrong one blocks its address for 1 s, each further one twice as long, up to 60 s.
 * Other addresses do not wait. An IPv6 visitor has a whole /64, which counts as one address.
 */
struct guess {
    struct in6_addr address;
    int64_t end;   /* of its block, ms */
    int64_t block; /* ms; 0: the entry is free */
};

struct guesses {
    struct guess guess[GUESS_ADDRESSES];
};

/* The address that counts, of a visitor's ("192.168.1.5", "::ffff:192.168.1.5", "fe80::1"). False: it is none. */
bool guess_address(const char *text, struct in6_addr *address);

/* Milliseconds that this address still has to wait; 0: it may try. `now`: ms, of a clock that is never set. */
int64_t guess_wait(const struct guesses *guesses, const struct in6_addr *address, int64_t now);

/* After a wrong guess. With all entries taken, the one whose block ends first is given up. */
void guess_was_wrong(struct guesses *guesses, const struct in6_addr *address, int64_t now);

/* After a right one: the address starts from 1 s again. */
void guess_was_right(struct guesses *guesses, const struct in6_addr *address);

#define LINK_SECONDS 120

/*
 * Links with which a visitor logs in once, for machines whose ddx.txt has no passphrase. `ddxpanel -login` leaves one
 * in a file of root's, from which the process of root takes it. Only one link counts: a new one makes the
 * former one invalid.
 */
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
