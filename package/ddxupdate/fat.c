/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "fat.h"

#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <string.h>

enum {
    ENTRY = 32,           /* bytes of an entry of a folder */
    NAME = 11,            /* bytes of its name, 8 and 3, padded with spaces */
    MOST_ENTRIES = 65536, /* of a folder; mkfs.vfat and Linux have the same limit */
    LABEL = 0x08,         /* attributes; parts of a long name have this one, too */
    FOLDER = 0x10,
};

struct volume {
    const struct fat_disk *disk;
    unsigned bits;         /* 12, 16 or 32 in an entry of the FAT */
    uint32_t fat;          /* sector of the first FAT */
    uint32_t root;         /* sector of the root (FAT12, FAT16), or its first cluster (FAT32) */
    uint32_t root_sectors; /* 0 on FAT32 */
    uint32_t data;         /* sector of cluster 2 */
    uint32_t per_cluster;  /* sectors */
    uint32_t clusters;     /* valid ones are 2 to clusters + 1 */
};

struct entry {
    uint32_t cluster, size;
    bool folder;
};

static uint32_t le16(const uint8_t *at) {
    return at[0] | (uint32_t)at[1] << 8;
}

static uint32_t le32(const uint8_t *at) {
    return le16(at) | le16(at + 2) << 16;
}

static int read_sector(const struct volume *volume, uint64_t sector, uint8_t *buffer) {
    if (sector >= volume->disk->size / FAT_SECTOR)
        return -EINVAL;
    return volume->disk->read(volume->disk->context, sector, buffer);
}

static int open_volume(struct volume *volume) {
    uint8_t boot[FAT_SECTOR];
    int error = read_sector(volume, 0, boot);

    if (error)
        return error;
    const uint32_t reserved = le16(boot + 14), fats = boot[16], root_entries = le16(boot + 17);
    const uint32_t total = le16(boot + 19) ? le16(boot + 19) : le32(boot + 32);
    const uint64_t fat_sectors = le16(boot + 22) ? le16(boot + 22) : le32(boot + 36);

    volume->per_cluster = boot[13];
    if (le16(boot + 510) != 0xAA55 || le16(boot + 11) != FAT_SECTOR || !volume->per_cluster ||
        (volume->per_cluster & (volume->per_cluster - 1)) || !reserved || !fats || !fat_sectors ||
        total > volume->disk->size / FAT_SECTOR)
        return -EINVAL;
    volume->root_sectors = (root_entries * ENTRY + FAT_SECTOR - 1) / FAT_SECTOR;
    const uint64_t root = reserved + fats * fat_sectors, data = root + volume->root_sectors;
    if (data >= total)
        return -EINVAL;
    volume->fat = reserved;
    volume->data = (uint32_t)data;
    volume->clusters = (total - volume->data) / volume->per_cluster;
    volume->bits = volume->clusters < 4085 ? 12 : volume->clusters < 65525 ? 16 : 32;
    volume->root = volume->bits == 32 ? le32(boot + 44) : (uint32_t)root;
    /* The FAT has an entry for each cluster, and only FAT32 has no fixed root. */
    if (((uint64_t)volume->clusters + 2) * volume->bits > fat_sectors * FAT_SECTOR * 8 ||
        (volume->bits == 32) != !volume->root_sectors)
        return -EINVAL;
    return 0;
}

static bool is_cluster(const struct volume *volume, uint32_t cluster) {
    return cluster >= 2 && cluster - 2 < volume->clusters;
}

static uint64_t sector_of(const struct volume *volume, uint32_t cluster) {
    return volume->data + (uint64_t)(cluster - 2) * volume->per_cluster;
}

/* The cluster after this one; not a valid one (is_cluster()) after the last. */
static int follow(const struct volume *volume, uint32_t cluster, uint32_t *next) {
    const uint64_t at = (uint64_t)cluster * volume->bits / 8;
    uint8_t buffer[2 * FAT_SECTOR] = {0};
    int error = read_sector(volume, volume->fat + at / FAT_SECTOR, buffer);

    if (!error && at % FAT_SECTOR == FAT_SECTOR - 1) /* an entry of FAT12 may be in two sectors */
        error = read_sector(volume, volume->fat + at / FAT_SECTOR + 1, buffer + FAT_SECTOR);
    if (error)
        return error;
    const uint8_t *found = buffer + at % FAT_SECTOR;
    if (volume->bits == 32)
        *next = le32(found) & 0x0FFFFFFF;
    else if (volume->bits == 16)
        *next = le16(found);
    else
        *next = cluster % 2 ? le16(found) >> 4 : le16(found) & 0xFFF;
    return 0;
}

/* 0 found, -ENOENT not in this sector and there may be more, 1 the folder's end. */
static int search_sector(const struct volume *volume, const uint8_t *sector, const char *name, struct entry *entry) {
    for (const uint8_t *at = sector; at < sector + FAT_SECTOR; at += ENTRY) {
        if (!at[0])
            return 1;
        if (at[11] & LABEL || memcmp(at, name, NAME) != 0)
            continue;
        entry->folder = at[11] & FOLDER;
        entry->cluster = le16(at + 26) | (volume->bits == 32 ? le16(at + 20) << 16 : 0);
        entry->size = le32(at + 28);
        return 0;
    }
    return -ENOENT;
}

static int search_sectors(const struct volume *volume, uint64_t first, uint32_t count, const char *name,
                          struct entry *entry) {
    uint8_t sector[FAT_SECTOR];
    int found = -ENOENT;

    for (uint32_t i = 0; i < count && found == -ENOENT; i++) {
        found = read_sector(volume, first + i, sector);
        if (!found)
            found = search_sector(volume, sector, name, entry);
    }
    return found;
}

/* Look up a name in a folder; cluster 0 is the root. */
static int search(const struct volume *volume, uint32_t cluster, const char *name, struct entry *entry) {
    int found = -ENOENT;

    if (!cluster && volume->bits != 32) {
        found = search_sectors(volume, volume->root, volume->root_sectors, name, entry);
        return found == 1 ? -ENOENT : found;
    }
    if (!cluster)
        cluster = volume->root;
    /* The chain may be a circle. */
    for (uint32_t left = MOST_ENTRIES * ENTRY / FAT_SECTOR / volume->per_cluster + 1; left && found == -ENOENT;
         left--) {
        if (!is_cluster(volume, cluster))
            break;
        found = search_sectors(volume, sector_of(volume, cluster), volume->per_cluster, name, entry);
        const int error = follow(volume, cluster, &cluster);
        if (error)
            return error;
    }
    return found == 1 ? -ENOENT : found;
}

/* The next part of a path as a name in a folder: "grub" is "GRUB       ". Returns the rest of the path, or NULL: no
 * such name is possible. */
static const char *take_name(const char *path, char name[NAME]) {
    const char *const end = path + strcspn(path, "/");
    unsigned at = 0, most = 8;

    memset(name, ' ', NAME);
    for (; path < end; path++) {
        if (*path == '.' && most == 8) {
            at = 8;
            most = NAME;
        } else if (at < most) {
            name[at++] = (char)toupper((unsigned char)*path);
        } else {
            return NULL;
        }
    }
    return *end ? end + 1 : end;
}

int fat_find(const struct fat_disk *disk, const char *path, struct fat_file *file) {
    struct volume volume = {.disk = disk};
    struct entry entry = {.folder = true};
    char name[NAME];
    int error = open_volume(&volume);

    while (!error && *path) {
        path = take_name(path, name);
        error = path && entry.folder ? search(&volume, entry.cluster, name, &entry) : -ENOENT;
    }
    if (error)
        return error;
    if (entry.folder)
        return -EISDIR;
    const uint32_t cluster_size = volume.per_cluster * FAT_SECTOR;
    const uint32_t count = entry.size / cluster_size + !!(entry.size % cluster_size);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t next;
        if (!is_cluster(&volume, entry.cluster + i))
            return -EINVAL;
        if (i + 1 == count)
            break;
        error = follow(&volume, entry.cluster + i, &next);
        if (error)
            return error;
        if (next != entry.cluster + i + 1)
            return -EFBIG;
    }
    *file = (struct fat_file){count ? sector_of(&volume, entry.cluster) * FAT_SECTOR : 0, entry.size};
    return 0;
}
