/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sockets that receive datagrams by IPv6 and IPv4, and multicast groups. */
#ifndef DDXVIDEO_LISTEN_H
#define DDXVIDEO_LISTEN_H

#include "network.h"

/*
 * Opens a port of all addresses of this machine; several programs may open it. Only IPv4 if the kernel has no IPv6. The
 * socket never blocks, and receives only multicast packets of groups that it has joined. Returns the socket, which the
 * caller closes, or -errno.
 */
int listen_open(uint16_t port);

/*
 * Joins a group at an interface (name or number; NULL: by the address or the routing table). 0 or -errno; -ENODEV
 * while the interface is missing.
 */
int listen_join(int fd, struct network_address *group, const char *interface);

#endif
