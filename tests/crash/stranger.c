/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A hostile program that speaks the protocol: neither its messages nor its files harm an honest program later. */
#include <dirent.h>
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
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

/* Waits until a message of this kind comes, in `packet`. */
static void hear(int fd, uint32_t operation) {
    struct pollfd wait = {.fd = fd, .events = POLLIN};

    do {
        ddx_packet_close(&packet);
        if (poll(&wait, 1, (int)(HANG / 1000000)) != 1 || ddx_receive(fd, &packet) != 1)
            fail("the store does not answer");
    } while (packet.message.operation != operation);
}

/* Opens the item; returns its layout, which the caller owns. */
static struct ddx_layout *open_item(int fd) {
    tell(fd, DDX_OPEN, 0, 0, NULL, -1);
    hear(fd, DDX_OPENED);
    return ddx_layout_copy(ddx_packet_layout(&packet));
}

/* A program that claims an item gets the pin pages of its readers, but can never write to them. */
static void pages_of_others(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    struct ddx_item_info info;
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    puppet_kill(writer);
    AWAIT(read_info(&info) && !info.writer_pid, "the store does not notice");
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

/* A file like one of the item's, of this epoch; NULL: its control page. `right`: made by the store's user. */
static int forge(const struct ddx_layout *layout, uint32_t epoch, const char *what, bool right) {
    uint64_t digest = 0xcbf29ce484222325u;
    char name[128];

    for (size_t i = 0; i < ddx_layout_bytes(layout->field_count); i++)
        digest = (digest ^ ((const unsigned char *)layout)[i]) * 0x100000001b3u;
    snprintf(name, sizeof name, "%s %u %016llx %s", stream_name[0], epoch, (unsigned long long)digest,
             what ? what : "control");
    if (!right && seteuid(65534)) /* without the right to change the user, use a wrong name */
        *name = '.';
    int file = ddx_memory_create(name, ddx_page_round(what ? sizeof(FRAME) : sizeof(struct ddx_control)), NULL);
    if (seteuid(getuid()) || file < 0)
        fail("a file cannot be made");
    if (what)
        return file;
    struct ddx_control *control = ddx_memory_map(file, sizeof *control, true);
    control->magic = DDX_CONTROL_MAGIC;
    control->version = DDX_LAYOUT_VERSION;
    control->epoch = epoch;
    atomic_store(&control->latest, DDX_LATEST(0, DDX_NO_SLOT));
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        atomic_store(&control->slot[i].generation, DDX_EMPTY);
    munmap(control, sizeof *control);
    ddx_memory_freeze(file);
    return file;
}

/* An epoch with the last number that pins can hold is offered, and the next one begins with it. */
static void last_number(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader[2] = {puppet_begin(NULL), puppet_begin(NULL)};
    struct ddx_item_info info = {0};
    int fd = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(fd);
    close(fd);
    int file = forge(layout, 0xffffff, NULL, true);
    fd = ddx_connect(DDX_STORE_PORT);
    tell(fd, DDX_OFFER, 0xffffff, DDX_FLAG_READER, layout, file);
    tell(fd, DDX_OFFER_END, 0, 0, NULL, -1);
    hear(fd, DDX_OFFERED);
    close(fd);
    close(file);
    free(layout);
    AWAIT(puppet_ask(writer, ORDER_WRITE, 1) == 1, "no program may write");
    /* In epoch 0x1000000 a pin on slot 0 and no pin would look alike. */
    if (!read_info(&info) || info.epoch <= 0xffffff || !(info.epoch & 0xffffff))
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

/* After a restart, a program offers its own files for an item whose writer has not come back yet. */
static void own_files(void) {
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 5, 5);
    ASK(reader, HOLD, 0, 5);
    int fd = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(fd);
    close(fd);
    puppet_stop(writer);
    puppet_stop(reader);
    store_kill();
    store_begin(NULL);
    AWAIT((fd = ddx_connect(DDX_STORE_PORT)) >= 0, "the store does not begin");
    int file[2] = {forge(layout, 7, NULL, false), ddx_memory_create("frames notice", ddx_page_round(1), NULL)};
    struct ddx_message message = {.operation = DDX_OFFER, .epoch = 7, .flags = DDX_FLAG_WRITER, .type = "FRAME"};
    strcpy(message.name, stream_name[0]);
    ddx_send(fd, &message, layout, file, 2);
    for (unsigned i = 0; i < 2; i++) {
        char what[16];

        snprintf(what, sizeof what, "frame %u", i);
        message = (struct ddx_message){.operation = DDX_OFFER_SLOT, .epoch = 7, .index = i};
        int slot = forge(layout, 7, what, false);
        ddx_memory_freeze(slot);
        ddx_send(fd, &message, NULL, &slot, 1);
        close(slot);
    }
    message = (struct ddx_message){.operation = DDX_OFFER_END, .flags = DDX_FLAG_WRITER};
    ddx_send(fd, &message, NULL, NULL, 0);
    struct pollfd wait = {.fd = fd, .events = POLLIN};
    if (poll(&wait, 1, (int)(HANG / 1000000)) != 1)
        fail("the store does not answer");
    puppet_go_on(writer);
    puppet_go_on(reader);
    struct ddx_item_info info;
    AWAIT(read_info(&info) && info.writer_pid == writer->pid && info.readers == 1, "the writer does not come back");
    ASK(writer, WRITE, 1, 6);
    ASK(reader, HOLD, 1, 6);
    close(fd);
    close(file[0]);
    close(file[1]);
    free(layout);
    puppets_end();
}

static unsigned files_of_store(void) {
    char path[64];
    unsigned count = 0;

    snprintf(path, sizeof path, "/proc/%d/fd", (int)store_process);
    DIR *folder = opendir(path);
    while (folder && readdir(folder))
        count++;
    if (folder)
        closedir(folder);
    return count;
}

/* Sends the message, however long the store takes to read; false: the store has hung up. */
static bool insist(int fd, const struct ddx_message *message, const struct ddx_layout *layout, int file) {
    struct pollfd room = {.fd = fd, .events = POLLOUT};
    int result;

    while ((result = ddx_send(fd, message, layout, &file, 1)) == -EAGAIN)
        if (poll(&room, 1, (int)(HANG / 1000000)) != 1)
            fail("the store does not listen");
    return !result;
}

/* An offer without an end: a control page, and each of these slots (or one slot repeatedly). */
static int endless_offer(const struct ddx_layout *layout, uint32_t epoch, int control, const int *slot, unsigned slots,
                         bool same) {
    struct ddx_message message = {.operation = DDX_OFFER, .epoch = epoch, .flags = DDX_FLAG_READER, .type = "FRAME"};
    int fd = ddx_connect(DDX_STORE_PORT);

    strcpy(message.name, stream_name[0]);
    bool listens = fd >= 0 && insist(fd, &message, layout, control);
    for (unsigned i = 0; i < slots && listens; i++) {
        message = (struct ddx_message){.operation = DDX_OFFER_SLOT, .epoch = epoch, .index = i};
        listens = insist(fd, &message, NULL, slot[same ? 0 : i]);
    }
    return fd;
}

/* Starts a store with that number of descriptors, independent of this machine's limit. */
static void store_begin_with(unsigned descriptors) {
    store_descriptors = descriptors;
    store_begin(NULL);
    store_descriptors = 0;
}

#define HOARDERS 8
#define HOARD 150

/* One program offers files without an end: others still get descriptors of the store. */
static void hoard(void) {
    int fd[2 * HOARDERS], slot[DDX_SLOTS_MAX], control = -1;
    unsigned slots = 0;

    store_begin_with(1024);
    struct puppet *writer = puppet_begin(NULL), *keeper = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(keeper, KEEP, HOARD, 0);
    ASK(keeper, HOLD, 0, 1);
    ASK(writer, WRITE, 10, 11);
    int guest = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(guest);
    struct ddx_message message = {.operation = DDX_ATTACH, .frames = 1};
    AWAIT(ddx_send(guest, &message, NULL, NULL, 0) == 0, "the store does not listen");
    hear(guest, DDX_EPOCH);
    uint32_t epoch = packet.message.epoch;
    control = ddx_packet_take(&packet, 0);
    while (slots < HOARD) {
        hear(guest, DDX_SLOT);
        if (packet.message.index == slots)
            slot[slots++] = ddx_packet_take(&packet, 0);
    }
    close(guest);
    unsigned before = files_of_store();
    for (unsigned i = 0; i < 2 * HOARDERS; i++)
        fd[i] = endless_offer(layout, epoch, control, slot, i < HOARDERS ? DDX_SLOTS_MAX : slots, i < HOARDERS);
    struct puppet *reader = puppet_begin(NULL);
    ASK(reader, HOLD, 0, 11);
    unsigned after = files_of_store();
    printf("a hoarder: %u of the store's %u descriptors, besides %u\n", after - before, 1024, before);
    if (after > before + 1024 / 4 + 2 * HOARDERS + 16)
        fail("a hoarder has %u descriptors of the store", after - before);
    for (unsigned i = 0; i < 2 * HOARDERS; i++)
        close(fd[i]);
    while (slots)
        close(slot[--slots]);
    close(control);
    free(layout);
    puppets_end();
}

#define GUESTS 20
#define CROWD 225 /* frames kept, more than a socket holds messages */

/* One program has many reading handles, and never reads messages: the descriptors in these must not starve others. */
static void never_listen(void) {
    struct ddx_message message = {.operation = DDX_OPEN};
    int fd[GUESTS];

    store_begin_with(1024);
    struct puppet *writer = puppet_begin(NULL), *keeper = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(keeper, KEEP, CROWD, 0);
    ASK(keeper, HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    strcpy(message.name, stream_name[0]);
    for (unsigned i = 0; i < GUESTS; i++) {
        uint64_t registered = stage->journal.passed[DDX_AT_STORE_REGISTERED];
        struct ddx_message attach = {.operation = DDX_ATTACH, .frames = 1};

        fd[i] = ddx_connect(DDX_STORE_PORT);
        if (fd[i] < 0 || ddx_send(fd[i], &message, NULL, NULL, 0) || ddx_send(fd[i], &attach, NULL, NULL, 0))
            fail("the store does not listen");
        AWAIT(stage->journal.passed[DDX_AT_STORE_REGISTERED] > registered, "a guest is not let in");
    }
    struct puppet *reader = puppet_begin(NULL);
    ASK(reader, HOLD, 1, 2);
    ASK(writer, WRITE, 1, 3);
    ASK(reader, HOLD, 1, 3);
    for (unsigned i = 0; i < GUESTS; i++)
        close(fd[i]);
    puppets_end();
}

/* A program comes back as a reader with a larger share than it ever had: others still read and write. */
static void large_shares(void) {
    int fd[3], pin;

    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL), *next = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    int guest = ddx_connect(DDX_STORE_PORT);
    struct ddx_layout *layout = open_item(guest);
    struct ddx_message message = {.operation = DDX_ATTACH, .frames = 1};
    ddx_send(guest, &message, NULL, NULL, 0);
    hear(guest, DDX_ATTACHED);
    pin = ddx_packet_take(&packet, 0);
    ddx_memory_freeze(pin);
    close(guest);
    for (unsigned i = 0; i < 3; i++) {
        fd[i] = ddx_connect(DDX_STORE_PORT);
        tell(fd[i], DDX_OFFER, 0, DDX_FLAG_READER, layout, -1);
        message = (struct ddx_message){.operation = DDX_OFFER_PIN, .frames = DDX_READERS_MAX};
        ddx_send(fd[i], &message, NULL, &pin, 1);
        message = (struct ddx_message){.operation = DDX_OFFER_END, .flags = DDX_FLAG_READER};
        ddx_send(fd[i], &message, NULL, NULL, 0);
        struct pollfd answer = {.fd = fd[i], .events = POLLIN};
        if (poll(&answer, 1, (int)(HANG / 1000000)) != 1)
            fail("the store does not answer");
    }
    puppet_kill(writer);
    AWAIT(puppet_ask(next, ORDER_WRITE, 1) == 2, "no program may write");
    ASK(reader, HOLD, 1, 2);
    for (unsigned i = 0; i < 3; i++)
        close(fd[i]);
    close(pin);
    free(layout);
    puppets_end();
}

/* A store with too few descriptors for a whole offer takes none of it until there are enough. */
static void few_descriptors(void) {
    struct rlimit all, few;
    struct ddx_item_info info;

    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *reader = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    ASK(reader, HOLD, 0, 1);
    ASK(writer, WRITE, 1, 2);
    puppet_stop(writer);
    puppet_stop(reader);
    store_kill();
    uint64_t listens = stage->journal.passed[DDX_AT_STORE_LISTENS];
    store_begin(NULL);
    AWAIT(stage->journal.passed[DDX_AT_STORE_LISTENS] > listens, "the store does not begin");
    int idle[3];
    for (unsigned i = 0; i < 3; i++)
        idle[i] = ddx_connect(DDX_STORE_PORT);
    AWAIT(files_of_store() >= 2 + 8, "the store does not listen"); /* . and .., its five, and these */
    prlimit(store_worker(), RLIMIT_NOFILE, NULL, &all);
    few = (struct rlimit){12, all.rlim_max}; /* for a connection, control page, notice, one slot */
    prlimit(store_worker(), RLIMIT_NOFILE, &few, NULL);
    uint64_t offered = stage->journal.passed[DDX_AT_KEEPER_OFFERED];
    puppet_go_on(writer);
    AWAIT(stage->journal.passed[DDX_AT_KEEPER_OFFERED] > offered + 1, "the writer does not try again");
    prlimit(store_worker(), RLIMIT_NOFILE, &all, NULL);
    puppet_go_on(reader);
    AWAIT(read_info(&info) && info.writer_pid == writer->pid && info.readers == 1, "a program does not come back");
    if (info.frames < 3)
        fail("%u frames are left of the item", info.frames);
    ASK(writer, WRITE, 20, 22);
    ASK(reader, LOOK, 0, 1);
    ASK(reader, HOLD, 1, 22);
    for (unsigned i = 0; i < 3; i++)
        close(idle[i]);
    puppets_end();
}

int test_stranger(void) {
    pages_of_others();
    last_number();
    own_files();
    hoard();
    never_listen();
    large_shares();
    few_descriptors();
    return 0;
}
