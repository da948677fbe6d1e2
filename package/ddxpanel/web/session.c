/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "session.h"

#include <limits.h>
#include <string.h>

/* All begin with the same length, so the oldest one ends first; a free one before any. */
static struct session *place(struct sessions *sessions) {
    struct session *best = &sessions->session[0];

    for (struct session *one = best; one < sessions->session + SESSIONS && best->number; one++)
        if (!one->number || one->end < best->end)
            best = one;
    return best;
}

int session_begin(struct sessions *sessions, int64_t now, char text[SECRET_TEXT + 1]) {
    struct session session = {.number = sessions->last < INT_MAX ? sessions->last + 1 : 1,
                              .end = now + SESSION_SECONDS};
    int error = secret_make(session.text);

    if (error)
        return error;
    memcpy(text, session.text, sizeof session.text);
    *place(sessions) = session;
    sessions->last = session.number;
    return (int)session.number;
}

unsigned session_find(const struct sessions *sessions, int64_t now, const char *text, size_t size) {
    char wanted[SECRET_TEXT + 1] = "";
    unsigned number = 0;

    if (size != SECRET_TEXT)
        return 0;
    memcpy(wanted, text, size);
    for (size_t i = 0; i < SESSIONS; i++) {
        const struct session *one = &sessions->session[i];

        if (one->number && one->end > now && secret_is(one->text, wanted))
            number = one->number;
    }
    return number;
}

void session_end(struct sessions *sessions, unsigned number) {
    for (size_t i = 0; i < SESSIONS; i++)
        if (sessions->session[i].number == number)
            explicit_bzero(&sessions->session[i], sizeof sessions->session[i]);
}
