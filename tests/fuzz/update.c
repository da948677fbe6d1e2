/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: what an update reads. The first byte of the input chooses the parser, the rest is its input. */
#include <assert.h>
#include <string.h>

#include "block.h"
#include "fat.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct bytes {
    const uint8_t *data;
    size_t size;
    unsigned reads;
};

static int read_sector(void *context, uint64_t sector, uint8_t *buffer) {
    struct bytes *bytes = context;

    assert(sector < bytes->size / FAT_SECTOR);
    memcpy(buffer, bytes->data + sector * FAT_SECTOR, FAT_SECTOR);
    assert(++bytes->reads < 100000);
    return 0;
}

static void fat(const uint8_t *data, size_t size) {
    struct bytes bytes = {data, size, 0};
    const struct fat_disk disk = {size, read_sector, &bytes};
    struct fat_file file;

    if (fat_find(&disk, "grub/grubenv", &file))
        return;
    assert(file.offset % FAT_SECTOR == 0);
    assert(file.offset + file.size <= size);
}

static void block(const uint8_t *data, size_t size) {
    struct block first, second;
    char text[BLOCK_SIZE] = {0};

    memcpy(text, data, size < sizeof text ? size : sizeof text);
    if (!block_parse(text, &first))
        return;
    block_format(&first, text);
    assert(block_parse(text, &second));
    assert(!memcmp(&first, &second, sizeof first));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!size)
        return 0;
    switch (data[0]) {
    case 'f': fat(data + 1, size - 1); break;
    case 'b': block(data + 1, size - 1); break;
    default: break;
    }
    return 0;
}
