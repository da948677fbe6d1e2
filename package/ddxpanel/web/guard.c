/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "guard.h"

#include <arpa/inet.h>
#include <limits.h>
#include <string.h>
#include <strings.h>

#define LONGEST 255 /* bytes of a host */

/* The length of the host in "host", "host:443", "[::1]" or "[::1]:443"; 0: it is none of these. */
static size_t host_length(const char *text) {
    size_t length = *text == '[' ? strcspn(text, "]") + 1 : strcspn(text, ":");
    const char *port = text + length;

    if (length > strlen(text) || length > LONGEST)
        return 0;
    if (*port && (*port != ':' || !port[1] || port[1 + strspn(port + 1, "0123456789")]))
        return 0;
    return length;
}

static bool is_address(const char *text) {
    char inside[LONGEST + 1];
    struct in6_addr address;
    size_t length = strlen(text);

    if (*text != '[')
        return inet_pton(AF_INET, text, &address) == 1;
    memcpy(inside, text + 1, length - 2);
    inside[length - 2] = 0;
    return inet_pton(AF_INET6, inside, &address) == 1;
}

bool guard_host(const char *host, const char *hostname) {
    char name[LONGEST + 1];
    size_t length = host_length(host), own = strlen(hostname);

    if (!length)
        return false;
    memcpy(name, host, length);
    name[length] = 0;
    if (is_address(name) || !strcasecmp(name, "localhost"))
        return true;
    return own && !strncasecmp(name, hostname, own) && (!name[own] || !strcasecmp(name + own, ".local"));
}

static bool is_own_origin(const char *origin, const char *host) {
    static const char scheme[] = "https://";

    return origin && !strncmp(origin, scheme, strlen(scheme)) && !strcasecmp(origin + strlen(scheme), host);
}

int guard_request(const struct scgi *request, const char *hostname, bool order) {
    const char *host = scgi_value(request, "HTTP_HOST"), *method = scgi_value(request, "REQUEST_METHOD");

    if (!host || !guard_host(host, hostname))
        return 403;
    if (!method || strcmp(method, order ? "POST" : "GET") != 0)
        return 405;
    if (order && (!is_own_origin(scgi_value(request, "HTTP_ORIGIN"), host) || !scgi_value(request, "HTTP_X_PANEL")))
        return 403;
    return 0;
}

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
