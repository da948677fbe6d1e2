/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A stranger who speaks the protocol: neither what it says nor what it is handed harms an honest program later. */
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "../../package/ddx/lib/memory.h"
#include "../../package/ddx/lib/ring.h"
#include "../../package/ddx/lib/wire.h"
#include "puppet.h"
#include "tests.h"

static struct ddx_packet packet;

static void tell(int fd, enum ddx_operation operation, uint32_t epoch, uint32_t flags, const struct ddx_layout *layout,
                 int file) {
    struct ddx_message message = {.operation = operation, .epoch = epoch, .flags = flags, .type = "FRAME"};

    strcpy(message.name, stream_name[0]);
    if (ddx_send(fd, &message, layout, &file, file >= 0 ? 1 : 0))
        fail("the store does not listen");
}

/* Until a message of this kind comes; it is in `packet`. */
static void hear(int fd, uint32_t operation) {
    struct pollfd wait = {.fd = fd, .events = POLLIN};

    do {
        ddx_packet_close(&packet);
        if (poll(&wait, 1, (int)(HANG / 1000000)) != 1 || ddx_receive(fd, &packet) != 1)
            fail("the store does not answer");
    } while (packet.message.operation != operation);
}

/* Opens the item; its layout, the caller's. */
static struct ddx_layout *open_item(int fd) {
    tell(fd, DDX_OPEN, 0, 0, NULL, -1);
    hear(fd, DDX_OPENED);
    return ddx_layout_copy(ddx_packet_layout(&packet));
}

/* Who claims an item gets the pin pages of its readers. It cannot write to them, then or later. */
static void pages_of_others(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    struct ddx_item_info info;
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    puppet_kill(writer);
    AWAIT(told_of(&info) && !info.writer_pid, "the store does not notice");
    int fd = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(fd);
    tell(fd, DDX_CLAIM, 0, 0, layout, -1);
    hear(fd, DDX_READER);
    if (ddx_memory_map(packet.fd[0], sizeof(struct ddx_pin_page), true))
        fail("a reader's pins can be written to");
    close(fd);
    free(layout);
    puppets_end();
}

/* An epoch with the last number that pins can tell is offered, and the next one begins with it. */
static void last_number(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader[2] = {puppet_begin(NULL), puppet_begin(NULL)};
    struct ddx_item_info info = {0};
    int fd = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(fd);
    close(fd);
    int file = ddx_memory_create("control", ddx_page_round(sizeof(struct ddx_control)));
    struct ddx_control *control = ddx_memory_map(file, sizeof *control, true);
    control->magic = DDX_CONTROL_MAGIC;
    control->version = DDX_LAYOUT_VERSION;
    control->epoch = 0xffffff;
    atomic_store(&control->latest, DDX_LATEST(0, DDX_NO_SLOT));
    ddx_memory_freeze(file);
    fd = ddx_connect(DDX_STORE_PORT);
    tell(fd, DDX_OFFER, 0xffffff, DDX_FLAG_READER, layout, file);
    tell(fd, DDX_OFFER_END, 0, DDX_FLAG_WRITER, NULL, -1);
    hear(fd, DDX_OFFERED);
    close(fd);
    munmap(control, sizeof *control);
    close(file);
    free(layout);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == 1, "nobody may write");
    /* Of the epoch 0x1000000 a pin on slot 0 would look like none, and none like a pin. */
    if (!told_of(&info) || info.epoch <= 0xffffff || !(info.epoch & 0xffffff))
        fail("epoch %u follows on %u", info.epoch, 0xffffff);
    for (unsigned i = 0; i < 2; i++) { /* one of them in slot 0 */
        ASK(reader[i], HOLD, 0, i + 1);
        ASK(writer, WRITE, 1, i + 2);
    }
    ASK(writer, WRITE, 20, 23);
    for (unsigned i = 0; i < 2; i++)
        ASK(reader[i], LOOK, 0, i + 1);
    for (unsigned i = 0; i < 2; i++) { /* slot 0 is free again */
        ASK(reader[i], HOLD, 0, i + 23);
        ASK(writer, WRITE, 1, i + 24);
    }
    ASK(writer, WRITE, 20, 45);
    ASK(writer, SHORT, 0, 0);
    puppets_end();
}

int test_stranger(void) {
    pages_of_others();
    last_number();
    return 0;
}
