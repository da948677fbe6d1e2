/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "network.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define IPV4_HEADER 20 /* bytes */
#define IPV6_HEADER 40
#define UDP_HEADER 8

/* A text in three parts. */
struct parts {
    char host[INET6_ADDRSTRLEN], zone[IF_NAMESIZE];
    const char *port; /* NULL: none */
};

static bool copy(char *to, size_t room, const char *from, size_t length) {
    if (!length || length >= room)
        return false;
    for (size_t i = 0; i < length; i++) { /* as a name of an interface may be; messages print it */
        if (from[i] <= ' ' || from[i] > '~')
            return false;
    }
    memcpy(to, from, length);
    to[length] = 0;
    return true;
}

/* One colon separates an IPv4 address from its port; an IPv6 address has two or more of its own. */
static bool split(const char *text, struct parts *parts) {
    bool brackets = *text == '[';
    const char *begin = text + brackets, *colon = strchr(text, ':');
    bool ipv6 = brackets || (colon && strchr(colon + 1, ':'));
    size_t length = brackets ? strcspn(begin, "]") : ipv6 || !colon ? strlen(text) : (size_t)(colon - text);
    const char *rest = begin + length;

    *parts = (struct parts){0};
    if (brackets && *rest++ != ']')
        return false;
    if (*rest == ':')
        parts->port = rest + 1;
    else if (*rest)
        return false;
    const char *percent = memchr(begin, '%', length);
    size_t host = percent ? (size_t)(percent - begin) : length;
    if (percent && (!ipv6 || !copy(parts->zone, sizeof parts->zone, percent + 1, length - host - 1)))
        return false;
    return copy(parts->host, sizeof parts->host, begin, host);
}

static bool take_port(const char *text, long *port) {
    size_t digits = strspn(text, "0123456789");

    if (!digits || digits > 5 || text[digits])
        return false;
    *port = strtol(text, NULL, 10);
    return true;
}

static bool parse_ipv6(const struct parts *parts, struct network_address *address) {
    struct in6_addr *host = &address->v6.sin6_addr;

    if (inet_pton(AF_INET6, parts->host, host) != 1 || IN6_IS_ADDR_V4MAPPED(host))
        return false;
    address->v6.sin6_family = AF_INET6;
    memcpy(address->zone, parts->zone, sizeof address->zone);
    return *address->zone || !IN6_IS_ADDR_LINKLOCAL(host);
}

bool network_parse(const char *text, long port, struct network_address *address) {
    struct parts parts;

    *address = (struct network_address){0};
    if (!split(text, &parts) || (parts.port && !take_port(parts.port, &port)) || port < 1 || port > UINT16_MAX)
        return false;
    if (inet_pton(AF_INET, parts.host, &address->v4.sin_addr) == 1) {
        address->v4.sin_family = AF_INET;
        if (*text == '[')
            return false;
    } else if (!parse_ipv6(&parts, address)) {
        return false;
    }
    network_set_port(address, (uint16_t)port);
    return true;
}

int network_find_zone(struct network_address *address) {
    if (!*address->zone)
        return 0;
    address->v6.sin6_scope_id = network_interface(address->zone);
    return address->v6.sin6_scope_id ? 0 : -ENODEV;
}

bool network_from(struct network_address *address, const struct sockaddr_storage *from) {
    *address = (struct network_address){0};
    if (from->ss_family == AF_INET) {
        memcpy(&address->v4, from, sizeof address->v4);
        return true;
    }
    if (from->ss_family != AF_INET6)
        return false;
    memcpy(&address->v6, from, sizeof address->v6);
    const struct sockaddr_in6 v6 = address->v6;
    if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
        *address = (struct network_address){.v4 = {.sin_family = AF_INET, .sin_port = v6.sin6_port}};
        memcpy(&address->v4.sin_addr, v6.sin6_addr.s6_addr + 12, 4);
    }
    if (v6.sin6_scope_id)
        snprintf(address->zone, sizeof address->zone, "%u", v6.sin6_scope_id);
    return true;
}

bool network_is_group(const struct network_address *address) {
    return network_is_ipv6(address) ? IN6_IS_ADDR_MULTICAST(&address->v6.sin6_addr)
                                    : IN_MULTICAST(ntohl(address->v4.sin_addr.s_addr));
}

bool network_is_any(const struct network_address *address) {
    return network_is_ipv6(address) ? IN6_IS_ADDR_UNSPECIFIED(&address->v6.sin6_addr)
                                    : address->v4.sin_addr.s_addr == htonl(INADDR_ANY);
}

socklen_t network_size(const struct network_address *address) {
    return network_is_ipv6(address) ? sizeof address->v6 : sizeof address->v4;
}

unsigned network_overhead(const struct network_address *address) {
    return (network_is_ipv6(address) ? IPV6_HEADER : IPV4_HEADER) + UDP_HEADER;
}

/* Both kinds have it at the same place. */
_Static_assert(offsetof(struct sockaddr_in, sin_port) == offsetof(struct sockaddr_in6, sin6_port), "port");

uint16_t network_port(const struct network_address *address) {
    return ntohs(address->v4.sin_port);
}

void network_set_port(struct network_address *address, uint16_t port) {
    address->v4.sin_port = htons(port);
}

const char *network_host(const struct network_address *address, char *text) {
    if (network_is_ipv6(address))
        inet_ntop(AF_INET6, &address->v6.sin6_addr, text, NETWORK_TEXT_MAX);
    else
        inet_ntop(AF_INET, &address->v4.sin_addr, text, NETWORK_TEXT_MAX);
    return text;
}

const char *network_text(const struct network_address *address, char *text) {
    char host[NETWORK_TEXT_MAX];
    bool ipv6 = network_is_ipv6(address);

    network_host(address, host);
    snprintf(text, NETWORK_TEXT_MAX, "%s%.45s%s%.15s%s:%u", ipv6 ? "[" : "", host, *address->zone ? "%" : "",
             address->zone, ipv6 ? "]" : "", network_port(address));
    return text;
}

const char *network_advice(int error, const char *interface) {
    return (error == -ENODEV || error == -ENETUNREACH) && !interface ? "; without a default route, name the network's "
                                                                       "interface: -interface eth0"
                                                                     : "";
}

unsigned network_interface(const char *name) {
    char *end, known[IF_NAMESIZE];
    unsigned index = if_nametoindex(name);

    if (index || *name < '0' || *name > '9')
        return index;
    unsigned long number = strtoul(name, &end, 10);
    return !*end && number <= INT32_MAX && if_indextoname((unsigned)number, known) ? (unsigned)number : 0;
}
