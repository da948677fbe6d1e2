/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Limits guesses of the passphrase: a wrong one blocks its address for 1 s, each further one twice as long, up to 60 s.
 * Other addresses do not wait. An IPv6 visitor has a whole /64, which counts as one address.
 */
#ifndef DDXPANEL_GUESS_H
#define DDXPANEL_GUESS_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>

#define GUESS_ADDRESSES 2048

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

#endif
