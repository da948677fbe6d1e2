/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "inlet.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* ---- Sockets that receive datagrams by IPv6 and IPv4, and multicast groups ---- */

#ifndef IPV6_MULTICAST_ALL /* Linux 4.20, but not in older headers */
#define IPV6_MULTICAST_ALL 29
#endif

#define BUFFER (1 << 20) /* bytes that may wait in the kernel while a picture is decoded */

static void set_option(int fd, int level, int option, int value) {
    setsockopt(fd, level, option, &value, sizeof value);
}

static int bind_ipv4(int fd, uint16_t port) {
    const struct sockaddr_in any = {.sin_family = AF_INET, .sin_port = htons(port)};

    return bind(fd, (const struct sockaddr *)&any, sizeof any);
}

static int bind_both(int fd, uint16_t port) {
    const struct sockaddr_in6 any = {.sin6_family = AF_INET6, .sin6_port = htons(port)};

    set_option(fd, IPPROTO_IPV6, IPV6_V6ONLY, 0);
    set_option(fd, IPPROTO_IPV6, IPV6_MULTICAST_ALL, 0); /* no packets of groups that only other programs have joined */
    return bind(fd, (const struct sockaddr *)&any, sizeof any);
}

int listen_open(uint16_t port) {
    const int kind = SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK;
    int fd = socket(AF_INET6, kind, 0);
    bool ipv6 = fd >= 0;

    if (!ipv6)
        fd = socket(AF_INET, kind, 0);
    if (fd < 0)
        return -errno;
    set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1); /* several programs may show one stream */
    set_option(fd, SOL_SOCKET, SO_RCVBUF, BUFFER);
    set_option(fd, IPPROTO_IP, IP_MULTICAST_ALL, 0);
    if (!(ipv6 ? bind_both(fd, port) : bind_ipv4(fd, port)))
        return fd;
    int error = -errno;
    close(fd);
    return error;
}

int listen_join(int fd, struct network_address *group, const char *interface) {
    unsigned index = interface ? network_interface(interface) : 0;

    if ((interface && !index) || network_find_zone(group))
        return -ENODEV;
    if (network_is_ipv6(group)) {
        const struct ipv6_mreq request = {.ipv6mr_multiaddr = group->v6.sin6_addr,
                                          .ipv6mr_interface = index ? index : group->v6.sin6_scope_id};

        return setsockopt(fd, IPPROTO_IPV6, IPV6_JOIN_GROUP, &request, sizeof request) ? -errno : 0;
    }
    const struct ip_mreqn request = {.imr_multiaddr = group->v4.sin_addr, .imr_ifindex = (int)index};
    return setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request) ? -errno : 0;
}

/* ---- The two ports of a stream ---- */

/* The port is -port's. */
static bool has_port(const char *group, const struct network_address *address) {
    return *group == '[' || (!network_is_ipv6(address) && strchr(group, ':'));
}

const char *inlet_parse(struct inlet *inlet, char *text) {
    if (!inlet->group || (network_parse(inlet->group, inlet->port, &inlet->address) &&
                          !has_port(inlet->group, &inlet->address) && network_is_group(&inlet->address)))
        return NULL;
    snprintf(text, NETWORK_ERROR_MAX,
             "-group %.80s: a multicast address such as " NETWORK_GROUP " or ff15::5 is needed, or none", inlet->group);
    return text;
}

static int open_port(long port, int *fd) {
    int opened = listen_open((uint16_t)port);

    *fd = opened < 0 ? -1 : opened;
    return opened < 0 ? opened : 0;
}

int inlet_open(struct inlet *inlet) {
    return open_port(inlet->port, &inlet->fd[INLET_MEDIA]);
}

int inlet_open_repair(struct inlet *inlet) {
    return open_port(inlet->port + NETWORK_REPAIR, &inlet->fd[INLET_REPAIR]);
}

int inlet_join(struct inlet *inlet) {
    if (inlet->joined || !inlet->group)
        return 0;
    for (int port = 0; port < INLET_PORTS; port++) {
        int error = inlet->fd[port] < 0 ? 0 : listen_join(inlet->fd[port], &inlet->address, inlet->interface);

        if (error && error != -EADDRINUSE) /* joined by an earlier attempt */
            return error;
    }
    inlet->joined = true;
    return 0;
}

void inlet_close(struct inlet *inlet) {
    for (int port = 0; port < INLET_PORTS; port++) {
        if (inlet->fd[port] >= 0)
            close(inlet->fd[port]);
        inlet->fd[port] = -1;
    }
}

ssize_t inlet_read(const struct inlet *inlet, enum inlet_port port, void *data, size_t size,
                   struct sockaddr_storage *from) {
    socklen_t length = sizeof *from;

    return recvfrom(inlet->fd[port], data, size, MSG_TRUNC, (struct sockaddr *)from, &length);
}
