/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Whom to believe: a store hands out memory, and what a program finds there is what it works with. */
#ifndef DDX_TRUST_H
#define DDX_TRUST_H

#include <stdbool.h>
#include <sys/types.h>

/*
 * The owner of the folder of this socket. 0; -ENOENT or the like: there is none; -EPERM: other users could have made
 * the folder, or can replace what is in it.
 */
int ddx_folder_owner(const char *path, uid_t *owner);

/* Whether the other side of the connection runs as root, as this user, or as the owner of the socket's folder. */
bool ddx_peer_trusted(int socket, uid_t owner);

#endif
