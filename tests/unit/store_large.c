/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Items with large frames: the kernel takes seconds to clear a few gigabytes on a busy machine. The holder gets a sign
 * of life with each step of this work, so that the worker does not seem to hang; and in each turn the worker makes one
 * file of a request, so that other clients are served in between.
 */
#include <sys/mman.h>
#include <unistd.h>

#include "../../package/ddx/store/budget.h"
#include "../../package/ddx/store/terms.h"
#include "../../package/ddx/store/items.h"
#include "holder_beats.h"
#include "store_alone.h"

#define STEPS 2 /* of a frame */
#define FRAME ((uint64_t)STEPS * DDX_MEMORY_STEP)
#define SLOTS 2 /* of an item without readers */
#define KEPT 2  /* frames, for a reader */

static const struct settings settings = {.budget = (uint64_t)1 << 30};
static struct ddx_packet packet;

static void ask(struct party *party, struct ddx_message message) {
    struct ddx_layout *layout = ddx_layout_opaque(FRAME);

    strcpy(message.name, "clip");
    strcpy(message.type, "BYTES");
    CHECK_EQUAL(ddx_send(party->socket, &message, layout, NULL, 0), 0);
    free(layout);
    client_receive(party->client, 1);
}

static void end(struct party *party) {
    close(party->socket);
    client_receive(party->client, 1);
    clients_sweep(store);
}

/* The next message, which must be of this operation; notices that readers know a file are skipped. */
static const struct ddx_message *hears(const struct party *party, uint32_t operation) {
    do {
        ddx_packet_close(&packet);
        CHECK_EQUAL(ddx_receive(party->socket, &packet), 1);
    } while (packet.message.operation != operation || packet.message.flags & DDX_FLAG_READER);
    return &packet.message;
}

/* A party that does not read for long gets the other messages later. */
static void open_clip(struct party *party) {
    ask(party, (struct ddx_message){.operation = DDX_OPEN, .flags = DDX_FLAG_CREATE});
    CHECK_EQUAL(hears(party, DDX_OPENED)->status, 0);
}

/* Maps, seals and reports the files, like the writer's program. */
static void ready(struct party *writer, uint32_t operation) {
    struct ddx_message m = *hears(writer, operation);
    int fd = ddx_packet_take(&packet, 0);
    unsigned slot = operation == DDX_SLOT ? m.index : DDX_NO_SLOT;
    size_t bytes = operation == DDX_SLOT ? FRAME : sizeof(struct ddx_control);
    void *map = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);

    CHECK(map != MAP_FAILED);
    CHECK_EQUAL(ddx_memory_freeze(fd), 0);
    close(fd);
    ask(writer, (struct ddx_message){.operation = DDX_READY, .epoch = m.epoch, .index = slot});
}

static void is_served(struct party *other) {
    ask(other, (struct ddx_message){.operation = DDX_INFO});
    hears(other, DDX_ITEM);
}

/* A claim: one file in each turn. Its memory is reserved at once, and no part of it twice. */
static void claim(struct party *writer, struct party *other) {
    unsigned before = beats;

    ask(writer, (struct ddx_message){.operation = DDX_CLAIM});
    const struct item *item = item_find(store, "clip");
    CHECK_EQUAL(item->pending->slots, 1);
    CHECK(beats - before >= STEPS);
    uint64_t reserved = budget_reserved(store);
    CHECK(reserved >= 2 * SLOTS * FRAME);
    is_served(other);
    ready(writer, DDX_CLAIMED);
    ready(writer, DDX_SLOT);
    CHECK(item->pending && !item->epoch);
    before = beats;
    CHECK(writers_go_on(store));
    CHECK_EQUAL(item->pending->slots, SLOTS);
    CHECK(beats - before >= STEPS);
    CHECK_EQUAL(budget_reserved(store), reserved);
    CHECK(!writers_go_on(store));
    files_commit();
    clients_tell(store, NULL);
    ready(writer, DDX_SLOT);
    CHECK(item->epoch && !item->pending);
    CHECK_EQUAL(hears(writer, DDX_DONE)->status, 0);
}

/* A reader that keeps several frames: one file in each turn; it is admitted after the last one. */
static void attach(struct party *writer, struct party *reader, struct party *other) {
    const struct item *item = item_find(store, "clip");

    ask(reader, (struct ddx_message){.operation = DDX_ATTACH, .frames = KEPT});
    for (unsigned made = 1; made < KEPT; made++) {
        CHECK_EQUAL(item->epoch->slots, SLOTS + made);
        CHECK_EQUAL(item->readers, 0);
        clients_tell(store, NULL);
        ready(writer, DDX_SLOT);
        is_served(other);
        client_receive(reader->client, 1);
    }
    CHECK_EQUAL(item->epoch->slots, SLOTS + KEPT);
    CHECK_EQUAL(item->readers, 1);
    ready(writer, DDX_SLOT);
    struct ddx_message file = *hears(writer, DDX_READER);
    ask(writer, (struct ddx_message){.operation = DDX_TAKEN, .index = file.index, .sequence = file.sequence});
    CHECK_EQUAL(hears(reader, DDX_ATTACHED)->status, 0);
    CHECK_EQUAL(item->notice->readers, 1);
}

/* A claimant that exits in between leaves nothing. */
static void give_up(struct party *writer, struct party *other) {
    ask(writer, (struct ddx_message){.operation = DDX_CLAIM});
    CHECK_EQUAL(item_find(store, "clip")->pending->slots, 1);
    end(writer);
    CHECK(!writers_go_on(store));
    CHECK(!item_find(store, "clip")->pending);
    unsigned before = beats;
    files_commit();
    CHECK(beats > before); /* the memory was freed */
    is_served(other);
}

int main(void) {
    for (unsigned i = 0; i < DDX_FDS_MAX; i++)
        packet.fd[i] = -1;
    store_make(&settings);
    struct party writer = begin(), next = begin(), reader = begin(), other = begin();

    open_clip(&writer);
    open_clip(&next);
    open_clip(&reader);
    open_clip(&other);
    give_up(&writer, &other);
    claim(&next, &other);
    attach(&next, &reader, &other);
    return 0;
}
