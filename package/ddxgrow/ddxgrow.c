/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Grows the last partition of a disk up to the disk's end, in the partition table and in the running kernel.
 *
 * The partition may be mounted; its begin, and all other partitions, remain unchanged. The table is written sector by
 * sector, the extended partition first, so that a power cut at any time leaves a valid table.
 */
#include <errno.h>
#include <inttypes.h>
#include <libfdisk/libfdisk.h>
#include <linux/blkpg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    MEGABYTE = 1 << 20,
    WORTH_IT = 16 * MEGABYTE, /* for less than this the table is not changed */
};
static const uint64_t most_sectors = UINT32_MAX; /* an MBR has 32 bits for the begin and the size of a partition */

static int fail(const char *disk, const char *what, int error) {
    if (error)
        fprintf(stderr, "ddxgrow: %s: %s: %s\n", disk, what, strerror(error < 0 ? -error : error));
    else
        fprintf(stderr, "ddxgrow: %s: %s\n", disk, what);
    return 1;
}

/* The partition with this index (from 0), which the caller frees; NULL if there is none. */
static struct fdisk_partition *look_up(struct fdisk_context *table, size_t index) {
    struct fdisk_partition *found = NULL;

    if (!fdisk_is_partition_used(table, index) || fdisk_get_partition(table, index, &found) != 0)
        return NULL;
    return found;
}

static int set_end(struct fdisk_context *table, size_t index, uint64_t begin, uint64_t end) {
    struct fdisk_partition *wanted = fdisk_new_partition();

    if (!wanted)
        return -ENOMEM;
    fdisk_partition_set_start(wanted, begin);
    fdisk_partition_set_size(wanted, end - begin);
    int error = fdisk_set_partition(table, index, wanted);
    fdisk_unref_partition(wanted);
    return error;
}

/* Update the kernel's table; it cannot reread the disk's while another partition, such as the root, is in use. */
static int tell_kernel(int fd, int number, uint64_t begin, uint64_t bytes) {
    struct blkpg_partition partition = {.start = (int64_t)begin, .length = (int64_t)bytes, .pno = number};
    struct blkpg_ioctl_arg argument = {.op = BLKPG_RESIZE_PARTITION, .datalen = sizeof partition, .data = &partition};

    return ioctl(fd, BLKPG, &argument) ? -errno : 0;
}

static int write_table(struct fdisk_context *table, const char *disk, int number, uint64_t begin, uint64_t end) {
    const uint64_t sector = fdisk_get_sector_size(table);
    const int fd = fdisk_get_devfd(table);
    int error = fdisk_write_disklabel(table);

    if (!error && fsync(fd))
        error = -errno;
    if (error)
        return fail(disk, "the partition table was not written", error);
    struct stat status;
    if (fstat(fd, &status) == 0 && S_ISBLK(status.st_mode)) {
        error = tell_kernel(fd, number, begin * sector, (end - begin) * sector);
        if (error)
            return fail(disk, "the partition table is written, the kernel reads it at the next start", error);
    }
    printf("ddxgrow: %s: partition %d has %" PRIu64 " MiB now\n", disk, number, (end - begin) * sector / MEGABYTE);
    return 0;
}

static int grow(struct fdisk_context *table, const char *disk, int number) {
    if (!fdisk_is_label(table, DOS))
        return fail(disk, "no MBR partition table", 0);
    const size_t index = (size_t)number - 1;
    struct fdisk_partition *partition = look_up(table, index);
    if (!partition)
        return fail(disk, "no such partition", 0);
    const uint64_t begin = fdisk_partition_get_start(partition);
    const uint64_t end = begin + fdisk_partition_get_size(partition);
    const int nested = fdisk_partition_is_nested(partition);
    const int container = fdisk_partition_is_container(partition);
    fdisk_unref_partition(partition);
    if (container)
        return fail(disk, "that is the extended partition; name the last one inside", 0);

    uint64_t around = 0;
    size_t extended = 0;
    for (size_t other = 0; other < fdisk_get_npartitions(table); other++) {
        partition = look_up(table, other);
        if (!partition)
            continue;
        const uint64_t start = fdisk_partition_get_start(partition);
        if (fdisk_partition_is_container(partition)) {
            extended = other;
            around = start;
        }
        fdisk_unref_partition(partition);
        if (start > begin)
            return fail(disk, "another partition follows that one", 0);
    }

    const uint64_t sector = fdisk_get_sector_size(table), grain = MEGABYTE / sector;
    uint64_t room = fdisk_get_nsectors(table);
    if (room > most_sectors) {
        printf("ddxgrow: %s: %" PRIu64 " MiB lie beyond what an MBR can name\n", disk,
               (room - most_sectors) * sector / MEGABYTE);
        room = most_sectors;
    }
    room -= room % grain;
    if (room < end + WORTH_IT / sector) {
        printf("ddxgrow: %s: nothing to do\n", disk);
        return 0;
    }
    int error = nested ? set_end(table, extended, around, room) : 0;
    if (!error)
        error = set_end(table, index, begin, room);
    if (error)
        return fail(disk, "the partition cannot be grown", error);
    return write_table(table, disk, number, begin, room);
}

int main(int count, char **words) {
    if (count == 2 && (!strcmp(words[1], "-version") || !strcmp(words[1], "--version")))
        return puts("ddxgrow " DDX_VERSION) < 0;
    char *rest = NULL;
    const long number = count == 3 ? strtol(words[2], &rest, 10) : 0;
    if (count != 3 || *rest || number < 1 || number > 60) {
        fprintf(stderr,
                "usage: ddxgrow DISK NUMBER     grow that partition, the disk's last one, up to the disk's end\n");
        return 2;
    }
    struct fdisk_context *table = fdisk_new_context();
    if (!table)
        return fail(words[1], "no memory", 0);
    fdisk_disable_dialogs(table, 1);
    int error = fdisk_assign_device(table, words[1], 0);
    if (error) {
        fdisk_unref_context(table);
        fail(words[1], "cannot be opened", error);
        return 1;
    }
    const int status = grow(table, words[1], (int)number);
    fdisk_deassign_device(table, 1);
    fdisk_unref_context(table);
    return status;
}
