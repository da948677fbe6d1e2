/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "layout.h"

#define FIXED_SIZE (F_SEAL_SHRINK | F_SEAL_GROW)
#define HUGE ((uint64_t)2 << 20) /* bytes mapped by one page table; moving whole page tables is cheap */

static uint64_t page_size(void) {
    return (uint64_t)sysconf(_SC_PAGESIZE);
}

uint64_t ddx_page_round(uint64_t bytes) {
    return (bytes + page_size() - 1) / page_size() * page_size();
}

/* Address space for a struct: whole page tables, unless it is smaller than one. */
DDX_HOT static uint64_t room_of(uint64_t span_bytes) {
    return span_bytes < HUGE ? span_bytes : (span_bytes + HUGE - 1) / HUGE * HUGE;
}

static void add_run(struct ddx_runs *runs, uint64_t begin, uint64_t end) {
    struct ddx_run *last = runs->count ? &runs->run[runs->count - 1] : NULL;

    begin = begin / page_size() * page_size();
    end = ddx_page_round(end);
    if (last && begin <= last->place + last->bytes) {
        if (end > last->place + last->bytes) {
            runs->file_bytes += end - last->place - last->bytes;
            last->bytes = end - last->place;
        }
        return;
    }
    runs->run[runs->count++] = (struct ddx_run){.place = begin, .file = runs->file_bytes, .bytes = end - begin};
    runs->file_bytes += end - begin;
}

void ddx_runs_of(const struct ddx_layout *layout, struct ddx_runs *runs) {
    runs->count = 0;
    runs->file_bytes = 0;
    runs->span_bytes = ddx_page_round(layout->size);
    if (!ddx_layout_extents(layout))
        add_run(runs, 0, layout->size);
    else
        for (unsigned i = 0; i < layout->field_count; i = ddx_layout_after(layout, i))
            if (layout->field[i].used)
                add_run(runs, layout->field[i].offset, layout->field[i].offset + layout->field[i].used);
    for (unsigned i = 0; i < runs->count; i++)
        runs->run[i].room = runs->run[i].bytes;
    /* The pages after the last run are beyond the end of the file: never accessed, only moved along. */
    struct ddx_run *last = runs->count ? &runs->run[runs->count - 1] : NULL;
    uint64_t end = last && runs->span_bytes >= HUGE ? (last->place + last->bytes + HUGE - 1) / HUGE * HUGE : 0;
    if (end && last->place <= end - HUGE)
        last->room = end - last->place;
}

/* If a signal interrupts a step (the worker was stopped), the step begins again. */
static int allocate(int fd, uint64_t bytes, void (*step)(void)) {
    for (uint64_t at = 0; at < bytes;) {
        uint64_t next = bytes - at < DDX_MEMORY_STEP ? bytes - at : DDX_MEMORY_STEP;

        if (fallocate(fd, 0, (off_t)at, (off_t)next)) {
            if (errno == EINTR)
                continue;
            return -errno;
        }
        at += next;
        if (step)
            step();
    }
    return 0;
}

int ddx_memory_create(const char *name, uint64_t bytes, void (*step)(void)) {
    int fd = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING);

    if (fd < 0)
        return -errno;
    /* Allocate now: writing a frame later must not fail for want of memory. */
    int result = allocate(fd, bytes, step);
    if (!result && fcntl(fd, F_ADD_SEALS, FIXED_SIZE))
        result = -errno;
    if (!result)
        return fd;
    close(fd);
    return result;
}

int ddx_memory_freeze(int fd) {
    return fcntl(fd, F_ADD_SEALS, F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) ? -errno : 0;
}

bool ddx_memory_sound(int fd, uint64_t bytes, bool frozen) {
    int required = FIXED_SIZE | (frozen ? F_SEAL_FUTURE_WRITE : 0);
    int seals = fcntl(fd, F_GET_SEALS);
    struct stat status;

    return seals >= 0 && (seals & required) == required && !fstat(fd, &status) && (uint64_t)status.st_size == bytes;
}

/* Bytes of the file that are locked as a mark; their content does not matter. */
enum mark { HELD, SHARED };

static int reopen(int fd, int flags) {
    char path[32];

    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    return open(path, flags | O_CLOEXEC);
}

static int reopen_marked(int fd, int flags, short type, enum mark mark) {
    struct flock lock = {.l_type = type, .l_whence = SEEK_SET, .l_start = mark, .l_len = 1};
    int own = reopen(fd, flags);

    if (own >= 0 && fcntl(own, F_OFD_SETLK, &lock)) {
        close(own);
        own = -1;
    }
    return own;
}

static bool is_marked(int fd, enum mark mark) {
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = mark, .l_len = 1};

    return !fcntl(fd, F_OFD_GETLK, &lock) && lock.l_type != F_UNLCK;
}

int ddx_memory_hold(int fd) {
    return reopen_marked(fd, O_RDWR, F_WRLCK, HELD);
}

bool ddx_memory_held(int fd) {
    return is_marked(fd, HELD);
}

int ddx_memory_share(int fd) {
    return reopen_marked(fd, O_RDONLY, F_RDLCK, SHARED);
}

bool ddx_memory_shared(int fd) {
    return is_marked(fd, SHARED);
}

int ddx_memory_watch(int fd) {
    return reopen(fd, O_RDONLY);
}

uint64_t ddx_memory_number(int fd) {
    struct stat status;

    return fstat(fd, &status) ? 0 : (uint64_t)status.st_ino;
}

bool ddx_memory_same(int a, int b) {
    struct stat x, y;

    return !fstat(a, &x) && !fstat(b, &y) && x.st_ino == y.st_ino && x.st_dev == y.st_dev;
}

void *ddx_memory_map(int fd, size_t bytes, bool writable) {
    int protection = PROT_READ | (writable ? PROT_WRITE : 0);
    void *address = mmap(NULL, bytes, protection, MAP_SHARED | MAP_POPULATE, fd, 0);

    return address == MAP_FAILED ? NULL : address;
}

void *ddx_slot_reserve(uint64_t span_bytes) {
    uint64_t alignment = span_bytes >= HUGE ? HUGE : page_size();
    size_t room = (size_t)room_of(span_bytes), size = room + (size_t)alignment;
    char *address = mmap(NULL, size, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

    if (address == MAP_FAILED)
        return NULL;
    size_t before = (size_t)((alignment - (uintptr_t)address % alignment) % alignment);
    if (before)
        munmap(address, before);
    munmap(address + before + room, size - before - room);
    return address + before;
}

int ddx_slot_map(void *base, const struct ddx_runs *runs, int fd, bool writable) {
    int protection = PROT_READ | (writable ? PROT_WRITE : 0);

    for (unsigned i = 0; i < runs->count; i++) {
        const struct ddx_run *run = &runs->run[i];

        if (mmap((char *)base + run->place, (size_t)run->room, protection, MAP_SHARED | MAP_FIXED | MAP_POPULATE, fd,
                 (off_t)run->file) == MAP_FAILED)
            return -errno;
    }
    return 0;
}

/* Number of mapped bytes of a run that lie in the first `span_bytes`. */
DDX_HOT static uint64_t mapped_within(const struct ddx_run *run, uint64_t span_bytes) {
    if (run->place + run->bytes > span_bytes)
        return run->place < span_bytes ? span_bytes - run->place : 0;
    return run->place + run->room <= room_of(span_bytes) ? run->room : run->bytes;
}

DDX_HOT int ddx_slot_move(void *from, void *to, const struct ddx_runs *runs, uint64_t span_bytes, int fd) {
    for (unsigned i = 0; i < runs->count; i++) {
        const struct ddx_run *run = &runs->run[i];
        size_t bytes = (size_t)mapped_within(run, span_bytes);
        char *source = (char *)from + run->place, *target = (char *)to + run->place;

        if (!bytes)
            break;
        /* DONTUNMAP leaves the source mapped, though empty: no other thread's mmap() can use the hole. */
        if (mremap(source, bytes, bytes, MREMAP_MAYMOVE | MREMAP_FIXED | MREMAP_DONTUNMAP, target) != MAP_FAILED)
            continue;
        /* Kernels before 5.13 cannot do this for shared memory; a new mapping costs page faults instead. */
        if (mmap(target, bytes, PROT_READ, MAP_SHARED | MAP_FIXED | MAP_POPULATE, fd, (off_t)run->file) == MAP_FAILED)
            return -errno;
    }
    return 0;
}

void ddx_slot_unmap(void *base, uint64_t span_bytes) {
    if (base)
        munmap(base, (size_t)room_of(span_bytes));
}
