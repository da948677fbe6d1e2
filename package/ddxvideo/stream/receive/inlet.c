/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "inlet.h"

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

int inlet_open(struct inlet *inlet) {
    inlet->fd = listen_open((uint16_t)inlet->port);
    return inlet->fd < 0 ? inlet->fd : 0;
}

int inlet_join(struct inlet *inlet) {
    if (inlet->joined || !inlet->group)
        return 0;
    int error = listen_join(inlet->fd, &inlet->address, inlet->interface);
    inlet->joined = !error;
    return error;
}

void inlet_close(struct inlet *inlet) {
    if (inlet->fd >= 0)
        close(inlet->fd);
    inlet->fd = -1;
}

ssize_t inlet_read(struct inlet *inlet, void *data, size_t size) {
    return recv(inlet->fd, data, size, MSG_TRUNC);
}
