/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "session.h"

#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>

/* All begin with the same length, so the oldest one ends first; a free one before any. */
static struct session *place(struct sessions *sessions) {
    struct session *best = &sessions->session[0];

    for (struct session *one = best; one < sessions->session + SESSIONS && best->number; one++)
        if (!one->number || one->end < best->end)
            best = one;
    return best;
}

int session_begin(struct sessions *sessions, int64_t now, char text[SESSION_TEXT + 1]) {
    struct session session = {.number = sessions->last < INT_MAX ? sessions->last + 1 : 1,
                              .end = now + SESSION_SECONDS};

    if (getrandom(session.key, sizeof session.key, 0) != (ssize_t)sizeof session.key)
        return -EIO;
    for (size_t i = 0; i < SESSION_BYTES; i++)
        snprintf(text + 2 * i, 3, "%02x", session.key[i]);
    *place(sessions) = session;
    sessions->last = session.number;
    return (int)session.number;
}

static int digit(char c) {
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

static bool parse(const char *text, size_t size, unsigned char key[SESSION_BYTES]) {
    if (size != SESSION_TEXT)
        return false;
    for (size_t i = 0; i < SESSION_BYTES; i++) {
        int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);

        if (high < 0 || low < 0)
            return false;
        key[i] = (unsigned char)(high << 4 | low);
    }
    return true;
}

/* Takes as long for any difference, or a visitor could find the key byte by byte. */
static bool same(const unsigned char *one, const unsigned char *other) {
    unsigned char difference = 0;

    for (size_t i = 0; i < SESSION_BYTES; i++)
        difference |= one[i] ^ other[i];
    return !difference;
}

unsigned session_find(const struct sessions *sessions, int64_t now, const char *text, size_t size) {
    unsigned char key[SESSION_BYTES];
    unsigned number = 0;

    if (!parse(text, size, key))
        return 0;
    for (size_t i = 0; i < SESSIONS; i++) {
        const struct session *one = &sessions->session[i];

        if (one->number && one->end > now && same(one->key, key))
            number = one->number;
    }
    return number;
}

void session_end(struct sessions *sessions, unsigned number) {
    for (size_t i = 0; i < SESSIONS; i++)
        if (sessions->session[i].number == number)
            explicit_bzero(&sessions->session[i], sizeof sessions->session[i]);
}
