/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where streams are by default, and what sender and receiver need of addresses. IPv4. */
#ifndef DDXVIDEO_NETWORK_H
#define DDXVIDEO_NETWORK_H

#include <netinet/in.h>
#include <stdbool.h>

/*
 * A stream has four ports from an even one on: RTP, RTCP (reports), repair packets, one in reserve; today only the
 * first is used. So a second stream of the same machine goes to port 8004.
 */
#define NETWORK_GROUP "239.255.20.5" /* in the range for use within a site */
#define NETWORK_PORT 8000
#define NETWORK_PORTS 4

#define NETWORK_ERROR_MAX 200

/* "address" or "address:port", numbers only, so that nothing waits for a name server. */
bool network_parse(const char *text, long port, struct sockaddr_in *address);

bool network_is_group(const struct sockaddr_in *address);

/* For messages: "address:port" into text[NETWORK_ERROR_MAX]. */
const char *network_text(const struct sockaddr_in *address, char *text);

/* Index of an interface, 0 if there is none of this name. */
int network_interface(const char *name);

#endif
