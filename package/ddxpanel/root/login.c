/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "login.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

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

int link_leave(const struct link *link, const char *path) {
    char new[PATH_MAX + 8];
    int error = 0;

    snprintf(new, sizeof new, "%s.new", path);
    unlink(new);
    int fd = open(new, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0)
        return -errno;
    if (write(fd, link, sizeof *link) != (ssize_t)sizeof *link)
        error = -EIO;
    close(fd);
    if (!error && rename(new, path))
        error = -errno;
    return error;
}

bool link_take(const char *path, int64_t now, const char *text) {
    struct link link;
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    bool good = fd >= 0 && read(fd, &link, sizeof link) == (ssize_t)sizeof link && !link.text[SECRET_TEXT];

    if (fd >= 0)
        close(fd);
    /* A file that cannot be removed would make the link work twice. */
    good = good && link_use(&link, now, text) && !unlink(path);
    explicit_bzero(&link, sizeof link);
    return good;
}
