/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "inlet.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define BUFFER (1 << 20) /* bytes that may wait in the kernel while a picture is decoded */

const char *inlet_parse(struct inlet *inlet, char *text) {
    if (!inlet->group || (!strchr(inlet->group, ':') && network_parse(inlet->group, inlet->port, &inlet->address) &&
                          network_is_group(&inlet->address)))
        return NULL;
    snprintf(text, NETWORK_ERROR_MAX, "-group %.80s: a multicast address such as " NETWORK_GROUP " is needed, or none",
             inlet->group);
    return text;
}

int inlet_open(struct inlet *inlet) {
    const struct sockaddr_in any = {.sin_family = AF_INET, .sin_port = htons((uint16_t)inlet->port)};
    const int yes = 1, no = 0, buffer = BUFFER;

    inlet->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (inlet->fd < 0)
        return -errno;
    setsockopt(inlet->fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes); /* several may look at one stream */
    setsockopt(inlet->fd, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
    setsockopt(inlet->fd, IPPROTO_IP, IP_MULTICAST_ALL, &no, sizeof no); /* not what others on this machine joined */
    return bind(inlet->fd, (const struct sockaddr *)&any, sizeof any) ? -errno : 0;
}

int inlet_join(struct inlet *inlet) {
    if (inlet->joined || !inlet->group)
        return 0;
    struct ip_mreqn request = {.imr_multiaddr = inlet->address.sin_addr};
    if (inlet->interface)
        request.imr_ifindex = network_interface(inlet->interface);
    if (inlet->interface && !request.imr_ifindex)
        return -ENODEV;
    if (setsockopt(inlet->fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request))
        return -errno;
    inlet->joined = true;
    return 0;
}

void inlet_close(struct inlet *inlet) {
    if (inlet->fd >= 0)
        close(inlet->fd);
    inlet->fd = -1;
}

ssize_t inlet_read(struct inlet *inlet, void *data, size_t size) {
    return recv(inlet->fd, data, size, MSG_TRUNC);
}
