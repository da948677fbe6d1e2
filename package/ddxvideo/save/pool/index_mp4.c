/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "index_mp4.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include "mp4_read.h"

struct mp4_entry *index_mp4_entries(const struct index_file *index, uint32_t frames) {
    struct mp4_times times = {.begun = false};
    struct mp4_entry *entries = calloc(frames, sizeof *entries);

    for (uint32_t i = 0; entries && i < frames; i++) {
        const struct index_entry *from = &index->entry[i];

        if (from->bytes < MP4_FRAGMENT) {
            free(entries);
            return NULL;
        }
        entries[i].bytes = from->bytes - MP4_FRAGMENT;
        entries[i].step = mp4_times_next(&times, from->time) | (from->flags & INDEX_KEY ? MP4_KEY : 0);
    }
    return entries;
}

/* Table and block 0 are not written in whole blocks: through the page cache, from which the caller flushes them. */
static int use_page_cache(struct pool_file *file) {
    int flags = fcntl(file->fd, F_GETFL);

    if (flags < 0 || fcntl(file->fd, F_SETFL, flags & ~O_DIRECT))
        return -errno;
    file->direct = false;
    return 0;
}

int index_mp4_finish(struct pool_file *file, struct index_file *index) {
    uint8_t block[MP4_BLOCK];
    struct mp4_format format;
    uint64_t end;

    if (index->header.format != INDEX_MP4)
        return 0;
    int error = use_page_cache(file);
    if (error)
        return error;
    ssize_t got = pread(file->fd, block, sizeof block, 0);
    if (got < 0)
        return -errno;
    if (got != (ssize_t)sizeof block || !mp4_read_head(block, &format, &end) || index->entry[0].offset != MP4_BLOCK)
        return -EBADMSG;
    struct mp4_entry *entries = index_mp4_entries(index, index->header.frames);
    if (!entries)
        return -ENOMEM;
    int64_t bytes = mp4_finish(file->fd, &format, entries, index->header.frames);
    free(entries);
    if (bytes < 0)
        return (int)bytes;
    index->header.bytes = (uint64_t)bytes;
    return 0;
}
