/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A store inside this test, used over socket pairs: its messages to each client, their order, and its state after a
 * client hangs up.
 */
#include <errno.h>
#include <sys/mman.h>
#include <unistd.h>

#include "../../package/ddx/store/budget.h"
#include "../../package/ddx/store/holder.h"
#include "../../package/ddx/store/items.h"
#include "store_alone.h"

#define FRAME 10000u
#define BUDGET 300000u

static const struct settings settings = {.budget = BUDGET};
static struct ddx_packet packet;

static void ask(struct party *party, struct ddx_message message, uint64_t size) {
    struct ddx_layout *layout = size ? ddx_layout_opaque(size) : NULL;

    strcpy(message.name, "clip");
    strcpy(message.type, "BYTES");
    CHECK_EQUAL(ddx_send(party->socket, &message, layout, NULL, 0), 0);
    free(layout);
    client_receive(party->client, 1);
}

/* The next message that the party receives. */
static const struct ddx_message *hears(const struct party *party, uint32_t operation) {
    ddx_packet_close(&packet);
    CHECK_EQUAL(ddx_receive(party->socket, &packet), 1);
    CHECK_EQUAL(packet.message.operation, operation);
    return &packet.message;
}

static void hears_nothing(const struct party *party) {
    ddx_packet_close(&packet);
    CHECK_EQUAL(ddx_receive(party->socket, &packet), 0);
}

/* Maps, seals and reports the files, like the writer's program. */
static void ready(struct party *writer, uint32_t epoch, unsigned slot, uint64_t bytes) {
    int fd = ddx_packet_take(&packet, 0);
    void *map = ddx_memory_map(fd, (size_t)bytes, true);

    CHECK(map);
    CHECK_EQUAL(ddx_memory_freeze(fd), 0);
    close(fd);
    ask(writer, (struct ddx_message){.operation = DDX_READY, .epoch = epoch, .index = slot}, 0);
}

static void becomes_writer(struct party *writer) {
    ask(writer, (struct ddx_message){.operation = DDX_OPEN, .flags = DDX_FLAG_CREATE}, FRAME);
    CHECK_EQUAL(hears(writer, DDX_OPENED)->status, 0);
    ask(writer, (struct ddx_message){.operation = DDX_CLAIM}, FRAME);
    uint32_t epoch = hears(writer, DDX_CLAIMED)->epoch;
    CHECK_EQUAL(epoch, 1);
    ready(writer, epoch, DDX_NO_SLOT, sizeof(struct ddx_control));
    for (unsigned slot = 0; slot < 2; slot++) {
        CHECK_EQUAL(hears(writer, DDX_SLOT)->index, slot);
        ready(writer, epoch, slot, FRAME);
    }
    CHECK_EQUAL(hears(writer, DDX_DONE)->status, 0);
    hears_nothing(writer);
}

/* The reader receives the epoch, its slots and pins only once the writer checks the pins and has the reader's slot. */
static void becomes_reader(struct party *reader, struct party *writer) {
    ask(reader, (struct ddx_message){.operation = DDX_OPEN}, 0);
    CHECK_EQUAL(hears(reader, DDX_OPENED)->status, 0);
    ask(reader, (struct ddx_message){.operation = DDX_ATTACH, .frames = 1}, 0);
    hears_nothing(reader);
    CHECK_EQUAL(hears(writer, DDX_SLOT)->index, 2);
    ready(writer, 1, 2, FRAME);
    struct ddx_message news = *hears(writer, DDX_READER);
    CHECK_EQUAL(hears(writer, DDX_SLOT)->flags, DDX_FLAG_READER | DDX_FLAG_WRITER);
    ask(writer, (struct ddx_message){.operation = DDX_TAKEN, .index = news.index, .sequence = news.sequence}, 0);
    CHECK_EQUAL(hears(reader, DDX_EPOCH)->index, 3);
    for (unsigned slot = 0; slot < 3; slot++)
        CHECK_EQUAL(hears(reader, DDX_SLOT)->index, slot);
    CHECK_EQUAL(hears(reader, DDX_ATTACHED)->status, 0);
    CHECK_EQUAL(item_find(store, "clip")->notice->readers, 1);
}

/* Opens an item with these names of item, type and field; returns the store's answer. */
static int opens_as(uint32_t operation, const char *name, const char *type, const char *field) {
    struct ddx_message message = {.operation = operation, .flags = DDX_FLAG_CREATE};
    struct ddx_layout *layout = malloc(ddx_layout_bytes(1));
    struct party party = begin();

    CHECK(layout);
    memset(layout, 0, ddx_layout_bytes(1));
    layout->size = layout->field[0].bytes = layout->field[0].used = 4;
    layout->field_count = layout->field[0].count = 1;
    layout->field[0].kind = DDX_KIND_INT;
    memcpy(layout->field[0].name, field, strlen(field));
    memcpy(message.name, name, strlen(name));
    memcpy(message.type, type, strlen(type));
    CHECK_EQUAL(ddx_send(party.socket, &message, layout, NULL, 0), 0);
    client_receive(party.client, 16);
    free(layout);
    int status = operation == DDX_OPEN ? hears(&party, DDX_OPENED)->status : 0;
    close(party.socket);
    client_receive(party.client, 16);
    clients_sweep(store);
    return status;
}

/* A client without the library: names that forge a line of a log, or control a terminal, are refused. */
static void names(void) {
    static const char *const bad[] = {"",           "two\nlines",    "\033[31mred", "tab\t",
                                      "delete\177", "eight\233bits", "\302\233"};
    static const char longest[] = "a23456789b23456789c23456789d23456789e23456789f23456789g23";
    const struct item *before = store->items;

    for (unsigned i = 0; i < sizeof bad / sizeof *bad; i++) {
        CHECK_EQUAL(opens_as(DDX_OPEN, bad[i], "int", ""), -EINVAL);
        CHECK_EQUAL(opens_as(DDX_OPEN, "name", bad[i], ""), -EINVAL);
        CHECK_EQUAL(opens_as(DDX_OPEN, "name", "POSE", *bad[i] ? bad[i] : "x y"), -EINVAL);
        opens_as(DDX_OFFER, bad[i], "int", "");
        opens_as(DDX_OFFER, "name", bad[i], "");
    }
    CHECK_EQUAL(opens_as(DDX_OPEN, "has space", "int", ""), -EINVAL);
    CHECK_EQUAL(opens_as(DDX_OPEN, "a/b", "int", ""), -EINVAL);
    CHECK(store->items == before);
    CHECK_EQUAL(opens_as(DDX_OPEN, longest, "unsigned long", "pose.x_1"), 0);
    CHECK_EQUAL(opens_as(DDX_OPEN, "~front-camera.0:video!", "a/b {c}", ""), 0);
}

static void no_errno(void) {
    static const int32_t bad[] = {INT32_MIN, -4096, 1};

    for (unsigned i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct party party = begin();

        ask(&party, (struct ddx_message){.operation = DDX_LIST, .status = bad[i]}, 0);
        CHECK(party.client->gone);
        clients_sweep(store);
        close(party.socket);
    }
}

int main(void) {
    for (unsigned i = 0; i < DDX_FDS_MAX; i++)
        packet.fd[i] = -1;
    store_make(&settings);

    names();
    no_errno();
    struct party writer = begin(), reader = begin(), late = begin();
    becomes_writer(&writer);
    becomes_reader(&reader, &writer);
    CHECK(budget_used(store) > 3 * FRAME && budget_used(store) < budget_reserved(store));

    /* No second writer; no more frames than fit. */
    ask(&late, (struct ddx_message){.operation = DDX_OPEN}, 0);
    CHECK_EQUAL(hears(&late, DDX_OPENED)->status, 0);
    ask(&late, (struct ddx_message){.operation = DDX_CLAIM}, FRAME);
    CHECK_EQUAL(hears(&late, DDX_DONE)->status, -EEXIST);
    ask(&late, (struct ddx_message){.operation = DDX_ATTACH, .frames = 30}, 0);
    CHECK_EQUAL(hears(&late, DDX_ATTACHED)->status, -EBUSY);

    /* A client that hung up holds nothing, even before the store has noticed. */
    close(reader.socket);
    ask(&late, (struct ddx_message){.operation = DDX_INFO}, 0);
    CHECK_EQUAL(hears(&late, DDX_ITEM)->readers, 0);
    CHECK_EQUAL(hears(&writer, DDX_READER_GONE)->status, 0);
    close(writer.socket);
    ask(&late, (struct ddx_message){.operation = DDX_CLAIM}, FRAME);
    CHECK_EQUAL(hears(&late, DDX_CLAIMED)->epoch, 2);
    clients_sweep(store);
    CHECK(store->clients == late.client && !late.client->next);
    return 0;
}
