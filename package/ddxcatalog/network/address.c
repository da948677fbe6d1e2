/* SPDX-License-Identifier: GPL-2.0-or-later */
/* DDS reads its addresses once, at its start. They may change: a lease ends, a robot joins another network. */
#include <ifaddrs.h>
#include <netinet/in.h>
#include <string.h>

#include "internal.h"

static bool is_reachable(const struct ifaddrs *one, const char *interface) {
    if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET || !(one->ifa_flags & IFF_UP))
        return false;
    return interface ? !strcmp(one->ifa_name, interface) : !(one->ifa_flags & IFF_LOOPBACK);
}

unsigned network_addresses(const char *interface, uint32_t address[NETWORK_ADDRESSES]) {
    struct ifaddrs *all;
    unsigned count = 0;

    if (getifaddrs(&all))
        return 0;
    for (const struct ifaddrs *one = all; one && count < NETWORK_ADDRESSES; one = one->ifa_next)
        if (is_reachable(one, interface))
            address[count++] = ((const struct sockaddr_in *)(const void *)one->ifa_addr)->sin_addr.s_addr;
    freeifaddrs(all);
    return count;
}

static bool has(const uint32_t *address, unsigned count, uint32_t wanted) {
    for (unsigned i = 0; i < count; i++)
        if (address[i] == wanted)
            return true;
    return false;
}

bool network_moved(const struct network *network) {
    uint32_t address[NETWORK_ADDRESSES];
    unsigned count = network_addresses(*network->interface ? network->interface : NULL, address);

    for (unsigned i = 0; i < network->addresses; i++)
        if (!has(address, count, network->address[i]))
            return true;
    return false;
}
