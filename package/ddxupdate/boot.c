/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "boot.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "fat.h"
#include "place.h"

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
