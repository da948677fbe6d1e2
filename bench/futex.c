/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The floor: frames in shared memory and one futex word that names the newest. No names, no late readers, no budget,
 * and nothing keeps the writer from overwriting the frame of a slow reader. No method that blocks can take less time.
 */
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "peer.h"

#define PAGE 4096u

static char path[128];
static size_t slot_bytes, bytes;
static unsigned slots;
static _Atomic(uint32_t) *newest; /* number of the newest frame */
static uint32_t seen;
static char *memory;
static void *own; /* NULL: no copying */

static char *slot(uint32_t number) {
    return memory + PAGE + number % slots * slot_bytes;
}

int peer_open(const struct peer_setup *setup, bool writer) {
    slots = setup->readers + 2; /* as many as the store has */
    bytes = setup->bytes;
    own = setup->mode == PEER_COPY ? setup->own : NULL;
    slot_bytes = (bytes + PAGE - 1) / PAGE * PAGE;
    size_t total = PAGE + slots * slot_bytes;
    snprintf(path, sizeof path, "/%s", setup->name);
    int fd = shm_open(path, writer ? O_RDWR | O_CREAT | O_EXCL : O_RDWR, 0600);
    if (fd < 0 || (writer && ftruncate(fd, (off_t)total)))
        return perror(path), 1;
    memory = mmap(NULL, total, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
    if (memory == MAP_FAILED)
        return perror(path), 1;
    close(fd);
    newest = (void *)memory;
    return 0;
}

void *peer_loan(void) {
    return slot(*newest + 1);
}

int peer_publish(void) {
    atomic_fetch_add_explicit(newest, 1, memory_order_release);
    syscall(SYS_futex, newest, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
    return 0;
}

int peer_write(const void *data) {
    memcpy(peer_loan(), data, bytes);
    return peer_publish();
}

int peer_receive(void (*deliver)(const void *data)) {
    uint32_t number = atomic_load_explicit(newest, memory_order_acquire);

    if (number == seen) {
        struct timespec until;

        clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_nsec += 100000000;
        if (until.tv_nsec >= 1000000000)
            until = (struct timespec){until.tv_sec + 1, until.tv_nsec - 1000000000};
        syscall(SYS_futex, newest, FUTEX_WAIT_BITSET, number, &until, NULL, FUTEX_BITSET_MATCH_ANY);
        number = atomic_load_explicit(newest, memory_order_acquire);
        if (number == seen)
            return 0;
    }
    seen = number;
    deliver(own ? memcpy(own, slot(number), bytes) : slot(number));
    return 0;
}

void peer_close(void) {
    shm_unlink(path); /* writer or reader, whichever is first */
}
