/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Which stores to trust: a program works with the content of the memory that the store hands out. */
#ifndef DDX_TRUST_H
#define DDX_TRUST_H

#include <stdbool.h>
#include <sys/types.h>

/*
 * The owner of the folder of this socket. 0; -ENOENT or similar: no folder; -EPERM: another user could have made the
 * folder, or can replace its content.
 */
int ddx_folder_owner(const char *path, uid_t *owner);

/* Whether the other side of the connection runs as root, as this user, or as the owner of the socket's folder. */
bool ddx_peer_trusted(int socket, uid_t owner);

#endif
