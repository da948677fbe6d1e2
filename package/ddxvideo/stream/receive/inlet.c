/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "inlet.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "listen.h"

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
