/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Hostile programs: one overwrites all memory that it can reach, one floods the store. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "../../package/ddx/lib/handle.h"
#include "stage.h"

#define HELD 1500 /* more than the store's descriptors */

/* Tries every way to write to a memory file; returns the number of successful ones. */
static unsigned break_into(int fd, size_t bytes) {
    char path[40];
    unsigned ways = 0;

    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    int again = open(path, O_RDWR | O_CLOEXEC);
    for (int i = 0; i < 2; i++) {
        int file = i ? again : fd;
        char *memory = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);

        if (memory != MAP_FAILED) {
            memset(memory, 0xee, bytes);
            ways++;
        }
        memory = mmap(NULL, bytes, PROT_READ, MAP_SHARED, file, 0);
        ways += memory != MAP_FAILED && !mprotect(memory, bytes, PROT_READ | PROT_WRITE);
        ways += !ftruncate(file, 0) || !ftruncate(file, (off_t)bytes * 2);
        ways += !fallocate(file, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, (off_t)bytes);
        ways += pwrite(file, "nonsense", 8, 0) > 0;
        ways += !fcntl(file, F_ADD_SEALS, F_SEAL_WRITE);
    }
    if (again >= 0)
        close(again);
    return ways;
}

/* Attacks the files of its own reading handle, then lies about its pins as fast as it can. */
void play_vandal(struct actor *me, unsigned stream) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);
    DDX_STORE_ITEM *item = actor_lookup(id, stream_name[stream]);
    struct ddx_frame frame;
    unsigned files = 0, turn = 0;

    while (ddx_store_acquire(item, &frame, 1, DDX_NEXT))
        nap(0.001);
    for (int fd = 3; fd < 1024; fd++) {
        struct stat status;
        int seals = fcntl(fd, F_GET_SEALS);

        if (seals < 0 || fstat(fd, &status) || ddx_memory_same(fd, item->reader.pin_fd))
            continue;
        files++;
        if (break_into(fd, (size_t)status.st_size))
            actor_fail("a reader can write to a frame");
    }
    if (files < 3)
        actor_fail("%u files to break into", files);
    me->frames = files;
    break_into(item->reader.pin_fd, ddx_page_round(1)); /* its own page may be written */
    for (uint32_t lie = 1; !leaving; lie = lie * 1664525 + 1013904223, me->beats++) {
        uint32_t epoch = item->reader.term->epoch;

        for (unsigned pin = 0; pin < DDX_PINS; pin++) /* garbage, then two steady lies, then garbage that fits */
            atomic_store(&item->reader.page->pin[pin], turn < 300000   ? lie
                                                       : turn < 600000 ? DDX_PIN(epoch, pin + 1)
                                                                       : DDX_PIN(epoch, (lie >> 20) % 24));
        turn = (turn + 1) % 1000000;
    }
    _exit(0);
}

static int link_up(void) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (ddx_socket_path(0, DDX_STORE_PORT, address.sun_path, sizeof address.sun_path) && fd >= 0 &&
        !connect(fd, (struct sockaddr *)&address, sizeof address))
        return fd;
    if (fd >= 0)
        close(fd);
    return -1;
}

/* As many connections as possible, items on half of them; half messages, unexpected descriptors, garbage. */
void play_flood(struct actor *me) {
    struct rlimit limit;
    struct ddx_layout *layout = ddx_layout_opaque(8);

    getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max;
    setrlimit(RLIMIT_NOFILE, &limit);
    srand(2005);
    for (unsigned i = 0; i < HELD && !leaving; i++) { /* idle connections */
        struct ddx_message message = {.operation = DDX_OPEN, .flags = DDX_FLAG_CREATE, .name = "guests", .type = "int"};
        int fd = link_up();

        if (fd < 0 || ddx_send(fd, &message, layout, NULL, 0))
            nap(0.0005);
    }
    for (unsigned i = 0; !leaving; i++, me->beats++) {
        struct ddx_message message = {.operation = i % 4 ? (uint32_t)rand() % 24 : DDX_OPEN, .flags = DDX_FLAG_CREATE};
        int fd = link_up();

        if (fd < 0) {
            nap(0.001);
            continue;
        }
        snprintf(message.name, sizeof message.name, i % 8 ? "flood%u" : "frames", i);
        strcpy(message.type, "int");
        int strange[2] = {fd, STDERR_FILENO};
        for (int k = 0; k < 4; k++) {
            if (k && i % 2) /* half of them stay idle */
                break;
            if (k)
                message.operation = (uint32_t)rand() % 24;
            message.index = (uint32_t)rand();
            message.frames = (uint32_t)rand() % 300;
            ddx_send(fd, &message, k % 2 ? NULL : layout, strange, i % 3);
        }
        if (i % 10 == 0 && send(fd, &message, (size_t)rand() % sizeof message, MSG_NOSIGNAL) < 0)
            close(fd); /* the others stay open until the store closes them */
    }
    _exit(0);
}
