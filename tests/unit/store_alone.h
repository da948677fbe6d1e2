/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A store without a separate process, and clients that talk to it over socket pairs. */
#ifndef STORE_ALONE_H
#define STORE_ALONE_H

#include <sys/socket.h>

#include "../../package/ddx/store/checkpoint.h"
#include "../../package/ddx/store/session.h"
#include "check.h"

static struct store *store;

struct party {
    int socket;
    struct client *client;
};

static inline void store_make(const struct settings *settings) {
    CHECK_EQUAL(checkpoint_begin(), 0);
    CHECK(!checkpoint_restore());
    store_memory();
    CHECK((store = store_begin(settings)));
}

static inline struct party begin(void) {
    int pair[2];

    CHECK_EQUAL(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair), 0);
    struct party party = {.socket = pair[0], .client = client_add(store, pair[1])};
    CHECK(party.client);
    return party;
}

#endif
