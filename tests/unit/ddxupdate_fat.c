/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The search for grub/grubenv on FAT12, FAT16 and FAT32, and on damaged ones. tests/host/test_update_block.py has file
 * systems that mkfs.vfat made. */
#include <errno.h>
#include <fat.h>

#include "check.h"

enum { S = FAT_SECTOR, FOLDER = 0x10, LONG_NAME = 0x0F, GRUB = 3, FILE_AT = 6 /* clusters */ };

struct image {
    uint8_t *bytes;
    uint64_t size;
    unsigned bits, fat, root, data; /* sectors */
    unsigned reads;
};

static int read_sector(void *context, uint64_t sector, uint8_t *buffer) {
    struct image *image = context;

    CHECK(sector < image->size / S);
    memcpy(buffer, image->bytes + sector * S, S);
    image->reads++;
    return 0;
}

static void put(uint8_t *at, uint32_t value, int bytes) {
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> 8 * i);
}

static void link_to(struct image *image, unsigned cluster, uint32_t next) {
    uint8_t *fat = image->bytes + image->fat * S;

    if (image->bits == 32)
        put(fat + cluster * 4, next, 4);
    else if (image->bits == 16)
        put(fat + cluster * 2, next, 2);
    else if (cluster % 2)
        put(fat + cluster * 3 / 2, (fat[cluster * 3 / 2] & 0xF) | next << 4, 2);
    else
        put(fat + cluster * 3 / 2, (next & 0xFFF) | (uint32_t)(fat[cluster * 3 / 2 + 1] >> 4) << 12, 2);
}

static uint8_t *cluster_at(const struct image *image, unsigned cluster) {
    return image->bytes + (image->data + (uint64_t)(cluster - 2)) * S;
}

static void add(uint8_t *entry, const char *name, int attributes, uint32_t cluster, uint32_t size) {
    memcpy(entry, name, 11);
    entry[11] = (uint8_t)attributes;
    put(entry + 20, cluster >> 16, 2);
    put(entry + 26, cluster, 2);
    put(entry + 28, size, 4);
}

/* One sector in a cluster, and grub/grubenv of two, after a label, a deleted file and a part of a long name. */
static struct image make(unsigned bits) {
    struct image image = {.bits = bits, .fat = bits == 32 ? 32 : 1};
    const unsigned clusters = bits == 32 ? 70000 : bits == 16 ? 5000 : 20;
    const unsigned fat_sectors = ((clusters + 2) * bits / 8 + S) / S;

    image.root = image.fat + 2 * fat_sectors;
    image.data = image.root + (bits == 32 ? 0 : 1);
    image.size = (uint64_t)(image.data + clusters) * S;
    image.bytes = calloc(1, image.size);
    CHECK(image.bytes);
    uint8_t *boot = image.bytes;
    put(boot + 11, S, 2);
    boot[13] = 1;
    put(boot + 14, image.fat, 2);
    boot[16] = 2;
    put(boot + 17, bits == 32 ? 0 : 16, 2);
    put(boot + (bits == 32 ? 36 : 22), fat_sectors, bits == 32 ? 4 : 2);
    put(boot + 32, image.data + clusters, 4);
    put(boot + 44, bits == 32 ? 2 : 0, 4);
    put(boot + 510, 0xAA55, 2);
    uint8_t *root = bits == 32 ? cluster_at(&image, 2) : boot + image.root * S;
    add(root, "DDXBOOT    ", 0x08, 0, 0);
    add(root + 32, "\xe5RUB       ", FOLDER, 9, 0);
    add(root + 64, "AGRUB      ", LONG_NAME, 0, 0);
    add(root + 96, "GRUB       ", FOLDER, GRUB, 0);
    link_to(&image, 2, 0xFFFFFFF);
    link_to(&image, GRUB, 5); /* the folder's second cluster */
    link_to(&image, 5, 0xFFFFFFF);
    for (int i = 0; i < S / 32; i++)
        add(cluster_at(&image, GRUB) + i * 32, "OTHER   CFG", 0, 9, 10);
    add(cluster_at(&image, 5), "GRUBENV    ", 0x20, FILE_AT, 1024);
    link_to(&image, FILE_AT, FILE_AT + 1);
    link_to(&image, FILE_AT + 1, 0xFFFFFFF);
    return image;
}

static int find(struct image *image, const char *path, struct fat_file *file) {
    const struct fat_disk disk = {image->size, read_sector, image};

    image->reads = 0;
    return fat_find(&disk, path, file);
}

static void finds_the_block(unsigned bits) {
    struct image image = make(bits);
    struct fat_file file;

    CHECK_EQUAL(find(&image, "grub/grubenv", &file), 0);
    CHECK_EQUAL(file.offset, (image.data + FILE_AT - 2) * S);
    CHECK_EQUAL(file.size, 1024);
    CHECK_EQUAL(find(&image, "GRUB/grubenv", &file), 0);
    CHECK_EQUAL(find(&image, "grub/other.cfg", &file), 0);
    CHECK_EQUAL(find(&image, "grub", &file), -EISDIR);
    CHECK_EQUAL(find(&image, "grub/none", &file), -ENOENT);
    CHECK_EQUAL(find(&image, "none/grubenv", &file), -ENOENT);
    CHECK_EQUAL(find(&image, "grub/grubenv/x", &file), -ENOENT);
    CHECK_EQUAL(find(&image, "grub/muchtoolong", &file), -ENOENT);
    free(image.bytes);
}

static void refuses(unsigned bits) {
    struct image image = make(bits);
    struct fat_file file;

    /* in two pieces */
    link_to(&image, FILE_AT, 9);
    CHECK_EQUAL(find(&image, "grub/grubenv", &file), -EFBIG);
    /* outside of the disk */
    add(cluster_at(&image, 5), "GRUBENV    ", 0x20, 0xFFFFFF0, 1024);
    CHECK_EQUAL(find(&image, "grub/grubenv", &file), -EINVAL);
    add(cluster_at(&image, 5), "GRUBENV    ", 0x20, FILE_AT, UINT32_MAX);
    CHECK(find(&image, "grub/grubenv", &file) < 0);
    /* a folder that is a circle */
    memset(cluster_at(&image, 5), 'x', S);
    link_to(&image, 5, GRUB);
    CHECK_EQUAL(find(&image, "grub/grubenv", &file), -ENOENT);
    CHECK(image.reads < 10000);
    free(image.bytes);
}

/* Any value in any field of the boot sector: no read outside of the disk, and an end. */
static void survives(unsigned bits) {
    struct image image = make(bits);
    struct fat_file file;

    for (int at = 11; at < 64; at++)
        for (int value = 0; value < 256; value += value < 4 ? 1 : 50) {
            const uint8_t before = image.bytes[at];
            image.bytes[at] = (uint8_t)value;
            if (!find(&image, "grub/grubenv", &file))
                CHECK(file.offset + 1024 <= image.size);
            image.bytes[at] = before;
        }
    image.bytes[510] = 0;
    CHECK_EQUAL(find(&image, "grub/grubenv", &file), -EINVAL);
    image.size = 0;
    CHECK_EQUAL(find(&image, "grub/grubenv", &file), -EINVAL);
    free(image.bytes);
}

int main(void) {
    for (unsigned bits = 12; bits <= 32; bits += bits == 12 ? 4 : 16) {
        finds_the_block(bits);
        refuses(bits);
        survives(bits);
    }
    return 0;
}
