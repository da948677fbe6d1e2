/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where packets come from: a multicast group, and senders that send to these ports directly. */
#ifndef DDXVIDEO_INLET_H
#define DDXVIDEO_INLET_H

#include <sys/types.h>

#include "network.h"

enum inlet_port { INLET_MEDIA, INLET_REPAIR, INLET_PORTS };

struct inlet {
    const char *group; /* address, or NULL for none */
    long port;
    const char *interface; /* name or number; NULL: as the routing table says */
    /* how it stands */
    struct network_address address;
    int fd[INLET_PORTS]; /* -1: not open */
    bool joined;
};

/* Understand the settings; NULL, or what is wrong with them, in text[NETWORK_ERROR_MAX]. */
const char *inlet_parse(struct inlet *inlet, char *text);

/* 0 or -errno: the port of media packets; that of repair packets. */
int inlet_open(struct inlet *inlet);
int inlet_open_repair(struct inlet *inlet);
void inlet_close(struct inlet *inlet);

/* Join the group unless that is done: to be tried again while there is no network. 0 or -errno. */
int inlet_join(struct inlet *inlet);

/*
 * A datagram, without waiting: its size, which may be more than `size`, and its sender, as sendto() takes it for the
 * same socket; -1 if there is none.
 */
ssize_t inlet_read(const struct inlet *inlet, enum inlet_port port, void *data, size_t size,
                   struct sockaddr_storage *from);

#endif
