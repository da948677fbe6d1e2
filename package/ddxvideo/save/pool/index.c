/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "index.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "crc32c.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the index is little endian");
_Static_assert(sizeof(struct index_entry) == 64, "entries have 64 bytes on all machines");
_Static_assert(sizeof(struct index_header) == 408, "the header fits into one sector, which is written whole or not");
_Static_assert(sizeof(struct index_file) == INDEX_BYTES, "the index has its size");

void index_seal_header(struct index_header *header) {
    memcpy(header->magic, INDEX_MAGIC, sizeof header->magic);
    header->crc = crc32c(0, header, offsetof(struct index_header, crc));
}

void index_seal_entry(struct index_entry *entry) {
    entry->crc = crc32c(0, entry, offsetof(struct index_entry, crc));
}

/* Whether it ends within its bytes, and has no control characters, since it is printed, and none of `without`. */
static bool is_text(const char *text, size_t bytes, const char *without) {
    size_t length = strnlen(text, bytes);

    for (size_t i = 0; i < length; i++)
        if (text[i] < ' ' || text[i] > '~' || strchr(without, text[i]))
            return false;
    return !text[bytes - 1];
}

bool index_good_header(const struct index_header *header) {
    return !memcmp(header->magic, INDEX_MAGIC, sizeof header->magic) &&
           header->crc == crc32c(0, header, offsetof(struct index_header, crc)) && header->state <= INDEX_NAMED &&
           is_text(header->item, sizeof header->item, "") && is_text(header->instance, sizeof header->instance, "") &&
           is_text(header->name, sizeof header->name, "/") && header->name[0] != '.';
}

bool index_good_entry(const struct index_entry *entry, uint64_t recording, uint32_t position) {
    return entry->recording == recording && entry->position == position &&
           entry->crc == crc32c(0, entry, offsetof(struct index_entry, crc));
}

uint32_t index_count(const struct index_file *index, uint64_t limit) {
    uint64_t end = 0;
    uint32_t count = 0;

    for (; count < INDEX_ENTRIES; count++) {
        const struct index_entry *entry = &index->entry[count];

        if (!index_good_entry(entry, index->header.recording, count) || (count && entry->offset != end) ||
            entry->offset > limit || entry->bytes > limit - entry->offset)
            break;
        end = entry->offset + entry->bytes;
    }
    return count;
}

uint16_t index_lost(uint16_t before, uint64_t more) {
    return more < (uint64_t)UINT16_MAX - before ? (uint16_t)(before + more) : UINT16_MAX;
}

void index_end(struct index_file *index, uint32_t frames) {
    struct index_header *header = &index->header;
    const struct index_entry *last = &index->entry[frames - 1];

    header->state = INDEX_FINISHED;
    header->frames = frames;
    header->bytes = last->offset + last->bytes;
    header->lost_store = header->lost_ring = header->lost_encode = 0;
    for (uint32_t i = 0; i < frames; i++) {
        header->lost_store += index->entry[i].lost_store;
        header->lost_ring += index->entry[i].lost_ring;
        header->lost_encode = index_lost(header->lost_encode, index->entry[i].lost_encode);
    }
}

int index_read(int fd, struct index_file *index) {
    for (size_t at = 0; at < sizeof *index;) {
        ssize_t got = pread(fd, (unsigned char *)index + at, sizeof *index - at, (off_t)at);

        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return -errno;
        if (!got)
            return -EBADMSG;
        at += (size_t)got;
    }
    return index_good_header(&index->header) ? 0 : -EBADMSG;
}
