/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "check.h"

#include <string.h>

#include "crc32c.h"
#include "video_layout.h"

static void judge(struct check *check, bool good) {
    if (!good && !check->bad++)
        check->first = check->last = check->frame;
    else if (!good && check->last + 1 == check->frame)
        check->last++;
    check->frame++;
    check->sum = 0;
}

static void take_head(struct check *check, const unsigned char *bytes, size_t size) {
    check->head = crc32c(check->head, bytes, size);
    if (check->position < sizeof check->line) {
        size_t room = sizeof check->line - (size_t)check->position;

        memcpy(check->line + check->position, bytes, size < room ? size : room);
    }
}

void check_bytes(struct check *check, const unsigned char *bytes, size_t size) {
    while (size && check->frame < check->frames) {
        const struct index_entry *entry = &check->index->entry[check->frame];
        bool inside = check->position >= entry->offset;
        uint64_t end = inside ? entry->offset + entry->bytes : entry->offset;
        size_t part = end - check->position < size ? (size_t)(end - check->position) : size;

        if (inside)
            check->sum = crc32c(check->sum, bytes, part);
        else
            take_head(check, bytes, part);
        bytes += part;
        size -= part;
        check->position += part;
        if (inside && check->position == end)
            judge(check, check->sum == entry->sum);
    }
    check->position += size;
    check->behind += size;
}

void check_end(struct check *check) {
    while (check->frame < check->frames)
        judge(check, false);
}

/* Whether the line, up to the first frame, is a header for pictures of the size of that frame. */
static bool fits(const struct check *check) {
    const struct index_entry *first = &check->index->entry[0];
    struct y4m_header header;
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    size_t length = (size_t)first->offset;

    if (!length || first->offset > sizeof line || check->line[length - 1] != '\n')
        return false;
    memcpy(line, check->line, length);
    line[length - 1] = 0;
    if (strlen(line) != length - 1 || !y4m_parse_header(line, Y4M_SAME, &header, error) ||
        !y4m_is_plain(&header))
        return false;
    uint64_t picture = video_layout_bytes(&header.geometry);
    return first->bytes > picture && first->bytes - picture < Y4M_FRAME_LINE_WRITTEN;
}

bool check_head(const struct check *check) {
    const struct index_header *header = &check->index->header;

    if (!check->frames)
        return true; /* its length is not known */
    return header->flags & INDEX_HEAD ? check->head == header->head : fits(check);
}
