/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Items with large frames: the kernel takes seconds to clear the memory of a thousand megabytes on a busy machine. The
 * holder gets a sign of life with each step of this work, so that the worker is not taken to hang.
 */
#include <sys/socket.h>
#include <unistd.h>

#include "../../package/ddx/store/holder.h"
#include "../../package/ddx/store/items.h"
#include "../../package/ddx/store/checkpoint.h"
#include "../../package/ddx/store/session.h"
#include "../../package/ddx/store/resume.h"
#include "check.h"

#define STEPS 3 /* of a frame */
#define FRAME ((uint64_t)STEPS * DDX_MEMORY_STEP)
#define SLOTS 2 /* of an item without readers */

static const struct settings settings = {.budget = (uint64_t)1 << 30};
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
};

static struct party begin(void) {
    int pair[2];

    CHECK_EQUAL(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair), 0);
    struct party party = {.socket = pair[0], .client = client_add(store, pair[1])};
    CHECK(party.client);
    return party;
}

static void ask(struct party *party, struct ddx_message message) {
    struct ddx_layout *layout = ddx_layout_opaque(FRAME);

    strcpy(message.name, "clip");
    strcpy(message.type, "BYTES");
    CHECK_EQUAL(ddx_send(party->socket, &message, layout, NULL, 0), 0);
    free(layout);
    client_receive(party->client, 1);
}

int main(void) {
    CHECK_EQUAL(checkpoint_begin(), 0);
    CHECK(!checkpoint_restore());
    store_memory();
    CHECK((store = store_begin(&settings)));
    struct party writer = begin();

    ask(&writer, (struct ddx_message){.operation = DDX_OPEN, .flags = DDX_FLAG_CREATE});
    unsigned before = beats;
    ask(&writer, (struct ddx_message){.operation = DDX_CLAIM});
    CHECK_EQUAL(item_find(store, "clip")->pending->slots, SLOTS);
    CHECK(beats - before >= SLOTS * STEPS);

    /* The memory is freed: a file takes a step. */
    close(writer.socket);
    client_receive(writer.client, 1);
    clients_sweep(store);
    before = beats;
    files_commit();
    CHECK(beats - before >= SLOTS);
    return 0;
}
