/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "outlet.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define NETWORK_PREFIX 8 /* bytes of an IPv6 address, /64 */

static const char *fail(char *text, const char *what, const char *value, const char *why) {
    snprintf(text, NETWORK_ERROR_MAX, "%s %.80s: %s", what, value, why);
    return text;
}

static bool add(struct outlet *outlet, const char *text) {
    struct network_address *receiver = &outlet->receiver[outlet->receivers];

    return outlet->receivers < OUTLET_RECEIVERS && network_parse(text, outlet->port, receiver) &&
           network_port(receiver) <= UINT16_MAX - NETWORK_PORTS + 1 && ++outlet->receivers;
}

const char *outlet_parse(struct outlet *outlet, char *text) {
    outlet->receivers = 0;
    if (outlet->group && (!add(outlet, outlet->group) || !network_is_group(&outlet->receiver[0])))
        return fail(text, "-group", outlet->group,
                    "a multicast address such as " NETWORK_GROUP " or ff15::5 is needed, or none");
    for (const char *at = outlet->to; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        char one[NETWORK_TEXT_MAX];

        snprintf(one, sizeof one, "%.*s", (int)strcspn(at, ","), at);
        if (!add(outlet, one))
            return fail(text, "-to", at,
                        "addresses are needed, such as 10.0.0.2, 10.0.0.2:8000, [fd00::2]:8000 or fe80::2%eth0, with "
                        "commas between");
    }
    return outlet->receivers ? NULL : "no receiver: give -to or -group";
}

/* ---- Sockets ---- */

/* The port for reports; 0: any. */
static struct network_address own_address(bool ipv6, long port) {
    if (ipv6)
        return (struct network_address){.v6 = {.sin6_family = AF_INET6, .sin6_port = htons((uint16_t)port)}};
    return (struct network_address){.v4 = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)}};
}

static bool set(int fd, int level, int option, int value) {
    return !setsockopt(fd, level, option, &value, sizeof value);
}

/* Whether the address is one of this machine's own. */
static bool is_local(const struct network_address *address) {
    struct network_address own = *address;
    int fd = socket(own.any.sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);

    network_set_port(&own, 0);
    bool local = fd >= 0 && !network_is_group(address) && !bind(fd, &own.any, network_size(&own));
    if (fd >= 0)
        close(fd);
    return local;
}

/*
 * If another sender of this machine has the port, or a player of this machine may need it, the system chooses one.
 * Receivers answer to the port from which packets come.
 */
static int bind_for_reports(struct outlet *outlet, int fd, bool ipv6) {
    set(fd, SOL_SOCKET, SO_REUSEADDR, outlet->group != NULL); /* players of a group share ports */
    struct network_address own = own_address(ipv6, outlet->elsewhere ? 0 : outlet->port + 1);
    if (!bind(fd, &own.any, network_size(&own)))
        return 0;
    if (errno != EADDRINUSE)
        return -errno;
    outlet->elsewhere = true;
    own = own_address(ipv6, 0);
    return bind(fd, &own.any, network_size(&own)) ? -errno : 0;
}

static bool choose_interface(int fd, bool ipv6, const char *name) {
    int index = (int)network_interface(name);
    const struct ip_mreqn from = {.imr_ifindex = index};

    if (!index)
        return false;
    return ipv6 ? set(fd, IPPROTO_IPV6, IPV6_MULTICAST_IF, index)
                : !setsockopt(fd, IPPROTO_IP, IP_MULTICAST_IF, &from, sizeof from);
}

static const char *open_socket(struct outlet *outlet, bool ipv6, char *text) {
    const char *kind = ipv6 ? "IPv6" : "IPv4";
    int fd = socket(ipv6 ? AF_INET6 : AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd < 0)
        return fail(text, "socket for", kind, strerror(errno));
    outlet->fd[ipv6 ? OUTLET_IPV6 : OUTLET_IPV4] = fd;
    if (ipv6)
        set(fd, IPPROTO_IPV6, IPV6_V6ONLY, 1);
    int error = bind_for_reports(outlet, fd, ipv6);
    if (error)
        return fail(text, "socket for", kind, strerror(-error));
    if (ipv6)
        set(fd, IPPROTO_IPV6, IPV6_MULTICAST_HOPS, (int)outlet->ttl);
    else
        set(fd, IPPROTO_IP, IP_MULTICAST_TTL, (int)outlet->ttl);
    if (outlet->interface && !choose_interface(fd, ipv6, outlet->interface))
        return fail(text, "-interface", outlet->interface, "there is none of this name");
    return NULL;
}

static int fd_for(const struct outlet *outlet, const struct network_address *receiver) {
    return outlet->fd[network_is_ipv6(receiver) ? OUTLET_IPV6 : OUTLET_IPV4];
}

const char *outlet_open(struct outlet *outlet, char *text) {
    const char *wrong = NULL;

    for (unsigned i = 0; i < outlet->receivers; i++) {
        struct network_address *receiver = &outlet->receiver[i];

        if (network_find_zone(receiver))
            return fail(text, "interface", receiver->zone, "there is none of this name");
        outlet->elsewhere |= is_local(receiver);
    }
    for (unsigned i = 0; i < outlet->receivers && !wrong; i++)
        if (fd_for(outlet, &outlet->receiver[i]) < 0)
            wrong = open_socket(outlet, network_is_ipv6(&outlet->receiver[i]), text);
    return wrong;
}

void outlet_close(struct outlet *outlet) {
    for (unsigned i = 0; i < OUTLET_SOCKETS; i++) {
        if (outlet->fd[i] >= 0)
            close(outlet->fd[i]);
        outlet->fd[i] = -1;
    }
}

static enum outlet_loss reason(int error) {
    switch (error) {
    case EAGAIN:
    case ENOBUFS:
    case ENOMEM: return OUTLET_BUSY;
    case ENETUNREACH:
    case EHOSTUNREACH:
    case ENETDOWN:
    case ENODEV:
    case EADDRNOTAVAIL:
    case EINVAL: /* a packet for another network, from an interface without an address */
    case EPERM: return OUTLET_ROUTE;
    default: return OUTLET_OTHER;
    }
}

unsigned outlet_send(struct outlet *outlet, enum outlet_port port, const uint8_t *packet, size_t size) {
    unsigned missed = 0;

    for (unsigned i = 0; i < outlet->receivers; i++) {
        struct network_address to = outlet->receiver[i];

        network_set_port(&to, (uint16_t)(network_port(&to) + port));
        ssize_t sent = sendto(fd_for(outlet, &to), packet, size, MSG_NOSIGNAL, &to.any, network_size(&to));

        if (sent == (ssize_t)size) {
            outlet->packets++;
            outlet->bytes += size;
            continue;
        }
        outlet->error = sent < 0 ? errno : EMSGSIZE;
        outlet->lost[reason(outlet->error)]++;
        missed |= 1u << i;
    }
    return missed;
}

bool outlet_send_to(const struct outlet *outlet, const struct network_address *to, const uint8_t *data, size_t size) {
    return sendto(fd_for(outlet, to), data, size, MSG_NOSIGNAL, &to->any, network_size(to)) == (ssize_t)size;
}

bool outlet_origin(const struct outlet *outlet, const struct network_address *to, struct network_address *own) {
    struct sockaddr_storage name;
    socklen_t size = sizeof name;
    int fd = socket(to->any.sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);

    if (fd < 0)
        return false;
    if (outlet->interface)
        choose_interface(fd, network_is_ipv6(to), outlet->interface);
    /* Sends nothing: the kernel only looks up the route. */
    bool found = !connect(fd, &to->any, network_size(to)) && !getsockname(fd, (struct sockaddr *)&name, &size) &&
                 network_from(own, &name) && !network_is_any(own);
    close(fd);
    return found;
}

/* FNV-1a */
static uint64_t hash(const void *data, size_t size, uint64_t sum) {
    const uint8_t *bytes = data;

    for (size_t i = 0; i < size; i++)
        sum = (sum ^ bytes[i]) * UINT64_C(1099511628211);
    return sum;
}

/* Without the port, and of an IPv6 address only the network: a single host has as many of both as it likes. */
static uint64_t hash_host(const struct sockaddr_storage *from) {
    const struct sockaddr_in *v4 = (const struct sockaddr_in *)from;
    const struct sockaddr_in6 *v6 = (const struct sockaddr_in6 *)from;
    uint64_t sum = UINT64_C(14695981039346656037) ^ from->ss_family;

    return from->ss_family == AF_INET6 ? hash(&v6->sin6_addr, NETWORK_PREFIX, sum)
                                       : hash(&v4->sin_addr, sizeof v4->sin_addr, sum);
}

ssize_t outlet_read(struct outlet *outlet, void *data, size_t size, uint64_t *address) {
    for (unsigned i = 0; i < OUTLET_SOCKETS; i++) {
        struct sockaddr_storage from = {0};
        socklen_t length = sizeof from;
        if (outlet->fd[i] < 0)
            continue;
        ssize_t got = recvfrom(outlet->fd[i], data, size, MSG_TRUNC, (struct sockaddr *)&from, &length);
        if (got >= 0) {
            *address = hash_host(&from);
            return got;
        }
    }
    return -1;
}
