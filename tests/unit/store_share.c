/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One process floods the store on many connections: in each turn of the worker it has no more than its share of
 * messages handled, another process has its own, and the holder gets a sign of life with each message. No connection
 * starves.
 */
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../../package/ddx/store/holder.h"
#include "../../package/ddx/store/checkpoint.h"
#include "../../package/ddx/store/process.h"
#include "../../package/ddx/store/session.h"
#include "../../package/ddx/store/resume.h"
#include "check.h"

#define CONNECTIONS 40
#define MESSAGES 30 /* on each, when the first turn begins; a socket holds some 160 */
#define SHARE 16    /* at most, of one process in one turn */
#define OTHER 1     /* the number of another process */

static const struct settings settings = {.budget = 1 << 20};
static struct store *store;
static unsigned beats;

/* In place of the holder. */
void holder_beat(void) {
    beats++;
}

void holder_serving(int socket) {
    (void)socket;
}

int holder_banned(void) {
    return -1;
}

unsigned holder_restarts(void) {
    return 0;
}

struct party {
    int socket;
    struct client *client;
    unsigned sent;
};

static struct party begin(void) {
    int pair[2];

    CHECK_EQUAL(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair), 0);
    struct party party = {.socket = pair[0], .client = client_add(store, pair[1])};
    CHECK(party.client);
    return party;
}

static void ask(struct party *party, uint32_t operation) {
    struct ddx_message message = {.operation = operation, .flags = DDX_FLAG_CREATE, .name = "clip", .type = "BYTES"};
    struct ddx_layout *layout = ddx_layout_opaque(8);

    message.number = ++party->sent;
    CHECK_EQUAL(ddx_send(party->socket, &message, operation == DDX_OPEN ? layout : NULL, NULL, 0), 0);
    free(layout);
}

/* A turn of the worker. */
static void turn(void) {
    static struct pollfd found[CONNECTIONS + 1];
    nfds_t count = 0;

    for (struct client *client = store->clients; client; client = client->next)
        found[count++] = (struct pollfd){.fd = client->socket, .events = POLLIN};
    CHECK_EQUAL(count, CONNECTIONS + 1);
    CHECK(poll(found, count, 0) >= 0);
    clients_hear(store, found);
}

static uint64_t handled(const struct party *party) {
    uint64_t sum = 0;

    for (unsigned i = 0; i < CONNECTIONS; i++)
        sum += party[i].client->handled;
    return sum;
}

int main(void) {
    struct party flood[CONNECTIONS], other;

    CHECK_EQUAL(checkpoint_begin(), 0);
    CHECK(!checkpoint_restore());
    store_memory();
    CHECK((store = store_begin(&settings)));
    other = begin();
    other.client->process->clients--;
    CHECK((other.client->process = process_join(store, OTHER)));
    for (unsigned i = 0; i < CONNECTIONS; i++) {
        flood[i] = begin();
        ask(&flood[i], DDX_OPEN);
        for (unsigned k = 1; k < MESSAGES; k++)
            ask(&flood[i], DDX_INFO);
    }
    ask(&other, DDX_OPEN);
    ask(&other, DDX_INFO);

    uint64_t all = (uint64_t)CONNECTIONS * MESSAGES, done = 0;
    for (unsigned i = 0; done < all; i++) {
        unsigned before = beats;
        uint64_t others = other.client->handled;

        turn();
        CHECK_EQUAL(other.client->handled, 2);
        uint64_t now = handled(flood);
        CHECK(now > done && now - done <= SHARE);
        CHECK(beats - before >= now - done + (2 - others));
        done = now;
        /* Each connection gets its turn, again and again: none waits until others have nothing more to ask. */
        if (i == 3 * CONNECTIONS / 2)
            for (unsigned k = 0; k < CONNECTIONS; k++)
                CHECK(flood[k].client->handled > 0);
    }
    CHECK_EQUAL(done, all);
    return 0;
}
