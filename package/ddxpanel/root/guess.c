/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "guess.h"

#include <arpa/inet.h>
#include <string.h>

#define FIRST 1000 /* ms */
#define LONGEST 60000
#define FORGET 600000 /* ms after the end of a block: a technician who mistyped starts from 1 s again */
#define NETWORK 8     /* bytes of an IPv6 address that belong to the network */

bool guess_address(const char *text, struct in6_addr *address) {
    struct in_addr four;

    *address = (struct in6_addr){.s6_addr = {[10] = 0xff, [11] = 0xff}};
    if (inet_pton(AF_INET, text, &four) == 1) {
        memcpy(address->s6_addr + 12, &four, sizeof four);
        return true;
    }
    if (inet_pton(AF_INET6, text, address) != 1)
        return false;
    if (!IN6_IS_ADDR_V4MAPPED(address))
        memset(address->s6_addr + NETWORK, 0, sizeof address->s6_addr - NETWORK);
    return true;
}

static const struct guess *find(const struct guesses *guesses, const struct in6_addr *address) {
    for (size_t i = 0; i < GUESS_ADDRESSES; i++)
        if (guesses->guess[i].block && !memcmp(&guesses->guess[i].address, address, sizeof *address))
            return &guesses->guess[i];
    return NULL;
}

int64_t guess_wait(const struct guesses *guesses, const struct in6_addr *address, int64_t now) {
    const struct guess *guess = find(guesses, address);

    return guess && guess->end > now ? guess->end - now : 0;
}

/* A free entry, or the one that is given up. */
static struct guess *place(struct guesses *guesses) {
    struct guess *best = &guesses->guess[0];

    for (size_t i = 0; i < GUESS_ADDRESSES && best->block; i++)
        if (!guesses->guess[i].block || guesses->guess[i].end < best->end)
            best = &guesses->guess[i];
    return best;
}

void guess_was_wrong(struct guesses *guesses, const struct in6_addr *address, int64_t now) {
    const struct guess *known = find(guesses, address);
    struct guess *guess = known ? &guesses->guess[known - guesses->guess] : place(guesses);
    bool again = known && now < guess->end + FORGET;
    int64_t block = again ? 2 * guess->block : FIRST;

    if (block > LONGEST)
        block = LONGEST;
    *guess = (struct guess){.address = *address, .end = now + block, .block = block};
}

void guess_was_right(struct guesses *guesses, const struct in6_addr *address) {
    for (size_t i = 0; i < GUESS_ADDRESSES; i++)
        if (!memcmp(&guesses->guess[i].address, address, sizeof *address))
            guesses->guess[i].block = 0;
}
