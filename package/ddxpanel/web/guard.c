/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "guard.h"

#include <arpa/inet.h>
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
