/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "segment_index.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#define PER_BLOCK (INDEX_BLOCK / (uint32_t)sizeof(struct index_entry))

void segment_index_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum, int64_t latency) {
    struct index_header *header = &segment->index->header;
    uint32_t position = segment->frames;

    if (!position) {
        header->start = frame->facts.time;
        header->wall = frame->facts.wall;
        header->head = segment->head;
        header->flags |= INDEX_HEAD;
    }
    struct index_entry *entry = &segment->index->entry[position];
    *entry = (struct index_entry){.recording = header->recording,
                                  .sequence = frame->facts.sequence,
                                  .time = frame->facts.time,
                                  .offset = frame->begin - segment->begin,
                                  .bytes = (uint32_t)(frame->end - frame->begin),
                                  .sum = sum,
                                  .position = position,
                                  .frame = frame->facts.frame,
                                  .lost_store = frame->facts.lost_store,
                                  .lost_ring = frame->facts.lost_ring};
    index_seal_entry(entry);
    segment->latency[position] = latency;
}

/* Brings written bytes to the disk. For files that were not prepared, metadata must be written as well, and not all of
 * it belongs to the file. */
static int sync_fd(const struct segment *segment, int fd) {
    int error = (segment->file.prepared ? fdatasync(fd) : syncfs(fd)) ? -errno : 0;

    if (error)
        *segment->unsafe = true;
    return error;
}

/* Writes the blocks with the entries from `first` up to `end`, exclusive. Later entries in these blocks are left out,
 * since their frames may not be on the disk. */
static int write_entries(const struct segment *segment, uint32_t first, uint32_t end) {
    _Alignas(INDEX_BLOCK) unsigned char block[INDEX_BLOCK];
    for (uint32_t at = first / PER_BLOCK * PER_BLOCK; at < end; at += PER_BLOCK) {
        uint32_t count = end - at < PER_BLOCK ? end - at : PER_BLOCK;

        memset(block, 0, sizeof block);
        memcpy(block, &segment->index->entry[at], count * sizeof(struct index_entry));
        off_t offset = (off_t)(INDEX_BLOCK + at * sizeof(struct index_entry));
        if (pwrite(segment->file.index_fd, block, sizeof block, offset) != (ssize_t)sizeof block)
            return errno ? -errno : -EIO;
    }
    return 0;
}

int segment_index_flush(struct segment *segment) {
    uint32_t frames = segment->frames;

    if (frames == segment->promised)
        return 0;
    if (*segment->unsafe)
        return -EIO;
    /* Frames first: an index must not promise frames that are not on the disk. */
    int error = sync_fd(segment, segment->fd);
    if (!error && !segment->promised)
        error = pool_write_header(&segment->file, &segment->index->header);
    if (!error)
        error = write_entries(segment, segment->promised, frames);
    if (!error)
        error = sync_fd(segment, segment->file.index_fd);
    for (; !error && segment->promised < frames; segment->promised++)
        ddx_stats_out_numbered(segment->book, segment->index->entry[segment->promised].sequence,
                               segment->latency[segment->promised]);
    ddx_stats_write(segment->book);
    return error;
}

int segment_index_finish(struct segment *segment, bool failed) {
    struct index_header *header = &segment->index->header;
    int error = segment_index_flush(segment); /* also after a failed write: complete frames may still get to the disk */

    if (failed)
        error = 0; /* has been reported */
    ddx_stats_lost(segment->book, LOST_WRITE, segment->frames - segment->promised);
    if (!segment->promised) {
        pool_give_back(&segment->file);
        return error;
    }
    index_end(segment->index, segment->promised);
    header->lost_store += segment->lost_store; /* lost after the last frame, so in no entry */
    header->lost_ring += segment->lost_ring;
    /* Entries that were given up may follow the last valid one in its block: write that again without them. */
    int other = write_entries(segment, segment->promised - 1, segment->promised);
    if (!other)
        other = pool_write_header(&segment->file, header);
    if (!other)
        other = sync_fd(segment, segment->file.index_fd);
    if (!other)
        other = pool_finish(segment->pool, &segment->file, header);
    else
        pool_release(&segment->file);
    return error ? error : other;
}
