/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Network interfaces, and whether the machine can be reached. */
#ifndef DDXUPDATE_NETWORK_H
#define DDXUPDATE_NETWORK_H

#include "place.h"

enum { LINKS_MAX = 16, LINK_NAME = 16, SSH_PORT = 22 };

struct link {
    char name[LINK_NAME];
    bool carrier; /* a cable, or a wireless network */
    bool address; /* IPv4, or IPv6 that is valid beyond the link */
};

struct network {
    struct link list[LINKS_MAX];
    unsigned count;
};

/* All interfaces but the loopback and the kernel's own tunnels. */
void network_look(const struct place *place, struct network *network);

/* NULL if there is none of that name. */
const struct link *network_find(const struct network *network, const char *name);

/* Whether a server on this machine's port answers as SSH does. Waits at most five seconds. */
bool ssh_answers(unsigned port);

#endif
