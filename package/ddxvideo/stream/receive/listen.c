/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "listen.h"

#include <errno.h>
#include <sys/socket.h>
#include <unistd.h>

#ifndef IPV6_MULTICAST_ALL /* Linux 4.20, but not in older headers */
#define IPV6_MULTICAST_ALL 29
#endif

#define BUFFER (1 << 20) /* bytes that may wait in the kernel while a picture is decoded */

static void set(int fd, int level, int option, int value) {
    setsockopt(fd, level, option, &value, sizeof value);
}

static int bind_ipv4(int fd, uint16_t port) {
    const struct sockaddr_in any = {.sin_family = AF_INET, .sin_port = htons(port)};

    return bind(fd, (const struct sockaddr *)&any, sizeof any);
}

static int bind_both(int fd, uint16_t port) {
    const struct sockaddr_in6 any = {.sin6_family = AF_INET6, .sin6_port = htons(port)};

    set(fd, IPPROTO_IPV6, IPV6_V6ONLY, 0);
    set(fd, IPPROTO_IPV6, IPV6_MULTICAST_ALL, 0); /* no packets of groups that only other programs have joined */
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
    set(fd, SOL_SOCKET, SO_REUSEADDR, 1); /* several programs may show one stream */
    set(fd, SOL_SOCKET, SO_RCVBUF, BUFFER);
    set(fd, IPPROTO_IP, IP_MULTICAST_ALL, 0);
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
