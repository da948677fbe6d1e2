/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Receives packets of a multicast group, and packets that are sent to these ports directly. */
#ifndef DDXVIDEO_INLET_H
#define DDXVIDEO_INLET_H

#include <sys/types.h>

#include "network.h"

enum inlet_port { INLET_MEDIA, INLET_REPAIR, INLET_PORTS };

struct inlet {
    const char *group; /* address, or NULL for none */
    long port;
    const char *interface; /* name or number; NULL: by the routing table */
    /* state: */
    struct network_address address;
    int fd[INLET_PORTS]; /* -1: not open */
    bool joined;
};

/* Check the settings. NULL, or the error in text[NETWORK_ERROR_MAX]. */
const char *inlet_parse(struct inlet *inlet, char *text);

/* 0 or -errno: the port of media packets; that of repair packets. */
int inlet_open(struct inlet *inlet);
int inlet_open_repair(struct inlet *inlet);
void inlet_close(struct inlet *inlet);

/* Join the group, if not done yet. Try again while there is no network. 0 or -errno. */
int inlet_join(struct inlet *inlet);

/*
 * Take a datagram, without waiting: its size, which may be more than `size`, and its sender, for sendto() on the same
 * socket; -1 if there is none.
 */
ssize_t inlet_read(const struct inlet *inlet, enum inlet_port port, void *data, size_t size,
                   struct sockaddr_storage *from);

/* ---- The sockets, for other ports as well ---- */

/*
 * Open a port of all addresses of this machine; several programs may open it. Only IPv4 if the kernel has no IPv6. The
 * socket never blocks, and receives only multicast packets of groups that it has joined. Returns the socket, which the
 * caller closes, or -errno.
 */
int listen_open(uint16_t port);

/*
 * Join a group at an interface (name or number; NULL: by the address or the routing table). 0 or -errno; -ENODEV
 * while the interface is missing.
 */
int listen_join(int fd, struct network_address *group, const char *interface);

#endif
