/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Sends packets to a multicast group and to single receivers. Receivers report to the port from which packets come,
 * PORT + 1. Neither sending nor reading waits.
 */
#ifndef DDXVIDEO_OUTLET_H
#define DDXVIDEO_OUTLET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "network.h"

#define OUTLET_RECEIVERS 16

/* One socket for each kind of address. */
enum { OUTLET_IPV4, OUTLET_IPV6, OUTLET_SOCKETS };

/* A port of a receiver, counted from the stream's first port. */
enum outlet_port { OUTLET_MEDIA = 0, OUTLET_REPAIR = 2 };

/* Reasons why a packet was not sent. */
enum outlet_loss { OUTLET_BUSY, OUTLET_ROUTE, OUTLET_OTHER, OUTLET_LOSSES };

struct outlet {
    const char *group; /* address, or NULL for no group */
    long port;
    long ttl;
    const char *interface; /* name or number; NULL: by the routing table */
    const char *to;        /* "address,..." as network_parse() reads them, or NULL */
    /* state: */
    int fd[OUTLET_SOCKETS]; /* -1: no receiver needs it */
    bool elsewhere;         /* reports come to a port that the system chose, not to PORT + 1 */
    struct network_address receiver[OUTLET_RECEIVERS];
    unsigned receivers;
    uint64_t packets, bytes, lost[OUTLET_LOSSES]; /* over all receivers */
    int error;                                    /* errno of the last packet that was not sent */
};

/* Check the settings. NULL, or the error in text[NETWORK_ERROR_MAX]. */
const char *outlet_parse(struct outlet *outlet, char *text);

/* Open the sockets for the receivers. NULL, or the error in text. Close it in each case. */
const char *outlet_open(struct outlet *outlet, char *text);
void outlet_close(struct outlet *outlet);

/* Send to all receivers. Returns a bit for each receiver for which that failed. */
unsigned outlet_send(struct outlet *outlet, enum outlet_port port, const uint8_t *packet, size_t size);

/*
 * A datagram that came to the port of the reports: its size, which may be more than `size` (the rest is cut off), and a
 * number that stands for its sender: its IPv4 address, or its IPv6 network (/64). -1 if there is none.
 */
ssize_t outlet_read(struct outlet *outlet, void *data, size_t size, uint64_t *address);

/* Send to an address of the same kind as a receiver's, without counting. Whether the kernel accepted it. */
bool outlet_send_to(const struct outlet *outlet, const struct network_address *to, const uint8_t *data, size_t size);

/* This machine's address in packets to `to`; false if there is no route, or no address, at the moment. */
bool outlet_origin(const struct outlet *outlet, const struct network_address *to, struct network_address *own);

#endif
