/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sockets that the process of root opens for the others. */
#ifndef DDXPANEL_LISTEN_H
#define DDXPANEL_LISTEN_H

#include <stdint.h>
#include <sys/types.h>

/* Listen on all addresses of the machine, IPv6 and IPv4 with one socket where there is IPv6. The socket, or -errno. */
int listen_tcp(uint16_t port);

/* Listen at a path, for one user only. The socket, or -errno. */
int listen_unix(const char *path, uid_t user);

#endif
