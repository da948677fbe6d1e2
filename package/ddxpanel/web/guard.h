/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a request must have before its words are looked at. */
#ifndef DDXPANEL_GUARD_H
#define DDXPANEL_GUARD_H

#include <stdbool.h>

#include "scgi.h"

/*
 * Whether the header Host names this machine: its host name, that with ".local", localhost, or an address, each with a
 * port or without. Another name may be one of a foreign page that leads here (DNS rebinding). An address cannot: the
 * browser reached the machine by it.
 */
bool guard_host(const char *host, const char *hostname);

/*
 * The status with which a request is answered before anything else: 0 none; 403 the Host is not this machine's, or an
 * order comes from another page; 405 not a method of this path. An order needs POST, the own Origin ("https://" and the
 * Host), and the header X-Panel, which no form of another page can send.
 */
int guard_request(const struct scgi *request, const char *hostname, bool order);

#endif
