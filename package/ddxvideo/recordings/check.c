/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "check.h"

#include "crc32c.h"

static void judge(struct check *check, bool good) {
    if (!good && !check->bad++)
        check->first = check->last = check->frame;
    else if (!good && check->last + 1 == check->frame)
        check->last++;
    check->frame++;
    check->sum = 0;
}

void check_bytes(struct check *check, const unsigned char *bytes, size_t size) {
    while (size && check->frame < check->frames) {
        const struct index_entry *entry = &check->index->entry[check->frame];
        bool inside = check->position >= entry->offset;
        uint64_t end = inside ? entry->offset + entry->bytes : entry->offset;
        size_t part = end - check->position < size ? (size_t)(end - check->position) : size;

        if (inside)
            check->sum = crc32c(check->sum, bytes, part);
        bytes += part;
        size -= part;
        check->position += part;
        if (inside && check->position == end)
            judge(check, check->sum == entry->sum);
    }
    check->position += size;
}

void check_end(struct check *check) {
    while (check->frame < check->frames)
        judge(check, false);
}
