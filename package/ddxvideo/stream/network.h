/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Default addresses of streams, and addresses for sender and receiver: IPv4 and IPv6, as numbers only. */
#ifndef DDXVIDEO_NETWORK_H
#define DDXVIDEO_NETWORK_H

#include <net/if.h>
#include <netinet/in.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/*
 * A stream has four ports from an even one on: RTP, RTCP (reports), repair packets, one in reserve. So a second stream
 * of the same machine goes to port 8004.
 */
#define NETWORK_GROUP "239.255.20.5" /* in the range for use within a site */
#define NETWORK_PORT 8000
#define NETWORK_PORTS 4
#define NETWORK_REPAIR 2 /* the port of repair packets, from the first one on */

#define NETWORK_ERROR_MAX 200
#define NETWORK_TEXT_MAX 80 /* bytes of an address as text, with the terminating zero */

struct network_address {
    union {
        struct sockaddr any;
        struct sockaddr_in v4;
        struct sockaddr_in6 v6;
    };
    char zone[IF_NAMESIZE]; /* IPv6: the interface after '%', by name or number; empty if there is none */
};

/*
 * Reads "10.0.0.2", "10.0.0.2:9000", "fd00::2", "[fd00::2]:9000", "fe80::2%eth0" or "[fe80::2%eth0]:9000"; `port` is
 * used if the text has none. Numbers only, so no name server is needed. False for anything else, for IPv4 addresses
 * written as IPv6 (::ffff:10.0.0.2), and for a link-local host without an interface. The interface need not exist yet:
 * network_find_zone().
 */
bool network_parse(const char *text, long port, struct network_address *address);

/* Looks up the interface that the address names, if it names one. 0, or -ENODEV while there is none of this name. */
int network_find_zone(struct network_address *address);

/* Copies an address that recvfrom() has returned; false if it is neither IPv4 nor IPv6. An IPv4 address that came
 * through an IPv6 socket becomes plain IPv4. */
bool network_from(struct network_address *address, const struct sockaddr_storage *from);

static inline bool network_is_ipv6(const struct network_address *address) {
    return address->any.sa_family == AF_INET6;
}

bool network_is_group(const struct network_address *address);

/* 0.0.0.0 or :: */
bool network_is_any(const struct network_address *address);

/* Bytes of the socket address, as sendto() and bind() take it. */
socklen_t network_size(const struct network_address *address);

/* Bytes that IP and UDP add to each datagram to this address: 28 or 48. */
unsigned network_overhead(const struct network_address *address);

uint16_t network_port(const struct network_address *address);
void network_set_port(struct network_address *address, uint16_t port);

/* The address without port and interface into text[NETWORK_TEXT_MAX], as SDP takes it. */
const char *network_host(const struct network_address *address, char *text);

/* For messages: "10.0.0.2:9000" or "[fe80::2%eth0]:9000" into text[NETWORK_TEXT_MAX]. */
const char *network_text(const struct network_address *address, char *text);

/* To add to a message on this error (-errno) of a multicast group: "; ... -interface eth0", or "". */
const char *network_advice(int error, const char *interface);

/* Index of an interface, by name or number; 0 if there is none. */
unsigned network_interface(const char *name);

#endif
