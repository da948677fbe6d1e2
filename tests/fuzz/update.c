/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: what an update reads. The first byte of the input chooses the parser, the rest is its input. */
#include <assert.h>
#include <string.h>

#include "block.h"
#include "fat.h"
#include "manifest.h"
#include "signature.h"
#include "ustar.h"

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

static void archive(const uint8_t *data, size_t size) {
    struct ustar_member member;

    if (size < USTAR_BLOCK || !ustar_parse(data, &member))
        return;
    assert(strlen(member.name) < USTAR_NAME);
    assert((member.size + ustar_padding(member.size)) % USTAR_BLOCK == 0);
}

static void manifest(const char *text, size_t size) {
    static struct manifest found;
    uint64_t sum = 0;

    if (manifest_parse(text, size, &found))
        return;
    assert(found.count > 0 && found.count <= MANIFEST_PIECES);
    for (unsigned i = 0; i < found.count; i++) {
        assert(manifest_piece(&found, i) > 0 && manifest_piece(&found, i) <= MEBIBYTE);
        sum += manifest_piece(&found, i);
    }
    assert(sum == found.size);
    assert(strlen(found.board) && strlen(found.board) < MANIFEST_WORD && strlen(found.version) < MANIFEST_WORD);
}

static void signature(const char *text, size_t size) {
    static const char message[] = "board=test\n";
    struct signature found;
    struct update_key key = {0};

    if (size > SIGNATURE_MAX || signature_parse(text, size, &found))
        return;
    assert(found.comment >= text && found.comment + found.comment_size <= text + size);
    memcpy(key.id, found.id, sizeof key.id);
    assert(!signature_fits(&found, &key, message, sizeof message - 1)); /* no signature fits a key of zeros */
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct update_key key;

    if (!size)
        return 0;
    const char *text = (const char *)data + 1;
    switch (data[0]) {
    case 'f': fat(data + 1, size - 1); break;
    case 'b': block(data + 1, size - 1); break;
    case 'a': archive(data + 1, size - 1); break;
    case 'k': key_parse(text, size - 1, &key); break;
    case 'm': manifest(text, size - 1); break;
    case 's': signature(text, size - 1); break;
    default: break;
    }
    return 0;
}
