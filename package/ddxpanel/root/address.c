/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "address.h"

#include <errno.h>
#include <ifaddrs.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stddef.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* FNV-1a, 64 bits */
#define SUM_BEGIN 0xcbf29ce484222325u
#define SUM_PRIME 0x100000001b3u

int address_watch(void) {
    const struct sockaddr_nl groups = {.nl_family = AF_NETLINK,
                                       .nl_groups = RTMGRP_LINK | RTMGRP_IPV4_IFADDR | RTMGRP_IPV6_IFADDR};
    int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, NETLINK_ROUTE);

    if (fd < 0)
        return -errno;
    if (!bind(fd, (const struct sockaddr *)&groups, sizeof groups))
        return fd;
    int error = -errno;
    close(fd);
    return error;
}

void address_forget(int watch) {
    char some[64];

    /* ENOBUFS: more changes than the socket had room for, which is a change, too. */
    while (recv(watch, some, sizeof some, MSG_TRUNC) > 0 || errno == ENOBUFS || errno == EINTR)
        errno = 0;
}

static uint64_t add(uint64_t sum, const void *bytes, size_t size) {
    for (const unsigned char *byte = bytes; size; size--)
        sum = (sum ^ *byte++) * SUM_PRIME;
    return sum;
}

uint64_t address_sum(void) {
    struct ifaddrs *all;
    uint64_t sum = 0;

    if (getifaddrs(&all))
        return 0;
    for (const struct ifaddrs *one = all; one; one = one->ifa_next) {
        if (!one->ifa_addr || (one->ifa_flags & IFF_LOOPBACK) || !(one->ifa_flags & IFF_UP))
            continue;
        uint64_t own = add(SUM_BEGIN, one->ifa_name, strlen(one->ifa_name));
        if (one->ifa_addr->sa_family == AF_INET)
            sum += add(own, &((const struct sockaddr_in *)(const void *)one->ifa_addr)->sin_addr, 4);
        else if (one->ifa_addr->sa_family == AF_INET6)
            sum += add(own, &((const struct sockaddr_in6 *)(const void *)one->ifa_addr)->sin6_addr, 16);
    }
    freeifaddrs(all);
    return sum;
}
