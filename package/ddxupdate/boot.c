/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "boot.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "command.h"
#include "fat.h"
#include "place.h"
#include "state.h"

#define GRUBENV "grub/grubenv"

enum { ALIGNED = 4096 }; /* memory for O_DIRECT */

static int read_at(int fd, uint64_t offset, void *buffer, size_t size) {
    const ssize_t done = pread(fd, buffer, size, (off_t)offset);

    return done == (ssize_t)size ? 0 : done < 0 ? -errno : -EIO;
}

static int read_sector(void *context, uint64_t sector, uint8_t *buffer) {
    _Alignas(ALIGNED) uint8_t aligned[FAT_SECTOR];
    const struct boot *boot = context;
    const int error = read_at(boot->fd, sector * FAT_SECTOR, aligned, sizeof aligned);

    if (!error)
        memcpy(buffer, aligned, sizeof aligned);
    return error;
}

static int find(struct boot *boot) {
    const off_t size = lseek(boot->fd, 0, SEEK_END);
    const struct fat_disk disk = {size < 0 ? 0 : (uint64_t)size, read_sector, boot};
    struct fat_file file;
    const int error = fat_find(&disk, GRUBENV, &file);

    if (error == -EINVAL)
        return fail(error, "%s: no FAT file system, or a damaged one", boot->device);
    if (error == -EFBIG || (!error && file.size != BLOCK_SIZE))
        return fail(-EINVAL, "%s: %s has another size, or is in pieces", boot->device, GRUBENV);
    if (error)
        return fail(error, "%s: %s cannot be read: %s", boot->device, GRUBENV, strerror(-error));
    boot->offset = file.offset;
    return 0;
}

int boot_open(struct boot *boot, const char *device, const char *lock) {
    int error;

    *boot = (struct boot){.device = device, .fd = -1};
    boot->lock = open(lock, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (boot->lock < 0 || flock(boot->lock, LOCK_EX)) {
        error = -errno;
        boot_close(boot);
        return fail(error, "%s: %s", lock, strerror(-error));
    }
    /* Exclusive: a partition that is mounted is refused. */
    boot->fd = open(device, O_RDWR | O_DIRECT | O_SYNC | O_EXCL | O_CLOEXEC);
    error = boot->fd < 0 ? fail(-errno, "%s: %s", device, errno == EBUSY ? "is mounted" : strerror(errno)) : find(boot);
    if (error)
        boot_close(boot);
    return error;
}

int boot_read(const struct boot *boot, char text[BLOCK_SIZE]) {
    _Alignas(ALIGNED) char aligned[BLOCK_SIZE];
    const int error = read_at(boot->fd, boot->offset, aligned, sizeof aligned);

    if (error)
        return fail(error, "%s: %s cannot be read: %s", boot->device, GRUBENV, strerror(-error));
    memcpy(text, aligned, sizeof aligned);
    return 0;
}

int boot_write(const struct boot *boot, const char text[BLOCK_SIZE]) {
    _Alignas(ALIGNED) char aligned[BLOCK_SIZE];

    memcpy(aligned, text, sizeof aligned);
    const ssize_t done = pwrite(boot->fd, aligned, sizeof aligned, (off_t)boot->offset);
    if (done == (ssize_t)sizeof aligned)
        return 0;
    const int error = done < 0 ? -errno : -EIO;
    return fail(error, "%s: %s cannot be written: %s", boot->device, GRUBENV, strerror(-error));
}

void boot_close(struct boot *boot) {
    if (boot->fd >= 0)
        close(boot->fd);
    if (boot->lock >= 0)
        close(boot->lock);
}

/*
 * `block` reports to the boot loader that this slot has come up (for its variables see board/common/grub.cfg), unless
 * it is on trial, and writes to /run/slot.failed the slot that should have come up and did not.
 *
 * The loader passes on the kernel's command line how it has counted this boot (ddx.counted). If its block does not have
 * that line, boots are not counted, and the loader would never return to the other slot: /run/slot.wrong reports this
 * for `ddxctl health`.
 */

enum { TRIAL = 3 }; /* exit status */

#define STAYS ", so a slot that cannot be booted may stay the chosen one; flash another card"

static void note_failed(const struct place *place, const struct block *block, bool lost) {
    char slot[] = {0, 0};

    if (place->here != block->slot && !lost)
        slot[0] = block->slot;
    if (block->failed)
        slot[0] = block->failed;
    if (slot[0])
        place_note(place->failed, slot);
}

/* The running slot is the chosen one, and not on trial. A trial that was kept may have left no note of that. */
static void prove(const struct place *place) {
    const char here[] = {place->here, 0};
    const struct state_line line = {"result", "kept"};

    state_prove(place->state, place->here);
    if (state_is(place->state, "tried", here) && state_is(place->state, "result", "begun"))
        state_set(place->state, &line, 1);
}

/* A block that was lost: the loader has booted slot A, whichever slot was chosen. */
static void restore(const struct place *place, struct block *block) {
    char text[128];

    *block = (struct block){.slot = state_proven(place->state)};
    if (!block->slot)
        block->slot = 'A';
    snprintf(text, sizeof text, "the boot loader's block was lost, and slot A booted; slot %c is the chosen one again",
             block->slot);
    place_note(place->wrong, text);
}

int command_block(const struct request *request) {
    const struct place *place = &request->place;
    char before[BLOCK_SIZE], after[BLOCK_SIZE];
    struct boot boot;
    struct block block;

    if (!place->here)
        return 0; /* started without our boot loader: it has no slots */
    if (boot_open(&boot, request->boot, place->block_lock)) {
        place_note(place->wrong, "the boot loader's block cannot be found" STAYS);
        return 1;
    }
    int error = boot_read(&boot, before);
    if (error) {
        place_note(place->wrong, "the boot partition cannot be read" STAYS);
    } else {
        const bool lost = !block_parse(before, &block);
        if (lost)
            restore(place, &block);
        else if (place->counted[0] && !block_has(&block, place->counted))
            place_note(place->wrong, "the boot loader has not counted this boot" STAYS);
        if (!lost && block_is_trial(&block, place->here)) {
            boot_close(&boot);
            return TRIAL;
        }
        block_came_up(&block, place->here);
        block_format(&block, after);
        if (memcmp(before, after, sizeof after) != 0)
            error = boot_write(&boot, after);
        if (error)
            place_note(place->wrong, "the boot partition cannot be written" STAYS);
        else if (place->here == block.slot)
            prove(place);
        note_failed(place, &block, lost);
    }
    boot_close(&boot);
    return error ? 1 : 0;
}
