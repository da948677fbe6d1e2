/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One process floods the store on many connections: each turn of the worker handles no more messages of it than its
 * share, another process keeps its own share, and the holder gets a sign of life with each message. No connection
 * starves.
 */
#include <poll.h>
#include <unistd.h>

#include "../../package/ddx/store/budget.h"
#include "holder_beats.h"
#include "store_alone.h"

#define CONNECTIONS 40
#define MESSAGES 30 /* on each connection, when the first turn begins; a socket holds about 160 */
#define SHARE 16    /* at most, of one process in one turn */
#define OTHER 1     /* the number of another process */

static const struct settings settings = {.budget = 1 << 20};

/* `sent`: number of messages of this connection so far. */
static void ask(const struct party *party, unsigned *sent, uint32_t operation) {
    struct ddx_message message = {.operation = operation, .flags = DDX_FLAG_CREATE, .name = "clip", .type = "BYTES"};
    struct ddx_layout *layout = ddx_layout_opaque(8);

    message.number = ++*sent;
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
    unsigned sent[CONNECTIONS] = {0}, sent_by_other = 0;

    store_make(&settings);
    other = begin();
    other.client->process->clients--;
    CHECK((other.client->process = process_join(store, OTHER)));
    for (unsigned i = 0; i < CONNECTIONS; i++) {
        flood[i] = begin();
        ask(&flood[i], &sent[i], DDX_OPEN);
        for (unsigned k = 1; k < MESSAGES; k++)
            ask(&flood[i], &sent[i], DDX_INFO);
    }
    ask(&other, &sent_by_other, DDX_OPEN);
    ask(&other, &sent_by_other, DDX_INFO);

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
        /* Connections take turns: none waits until the others have no more messages. */
        if (i == 3 * CONNECTIONS / 2)
            for (unsigned k = 0; k < CONNECTIONS; k++)
                CHECK(flood[k].client->handled > 0);
    }
    CHECK_EQUAL(done, all);
    return 0;
}
