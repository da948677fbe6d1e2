/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "segment.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "index_mp4.h"
#include "program.h"

/* ---- The index of a pool file ---- */

#define PER_BLOCK (INDEX_BLOCK / (uint32_t)sizeof(struct index_entry))

/* As segment_add(), segment_flush() and segment_finish(), for pool files. */
static void segment_index_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum,
                              int64_t latency) {
    struct index_header *header = &segment->index->header;
    uint32_t position = segment->frames;

    if (!position) {
        header->start = frame->facts.time;
        header->wall = frame->facts.wall;
        header->head = segment->head;
        header->flags |= INDEX_HEAD;
    }
    uint16_t flags = frame->facts.step & MP4_KEY ? INDEX_KEY : 0;
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
                                  .lost_ring = frame->facts.lost_ring,
                                  .flags = flags,
                                  .lost_encode = index_lost(0, frame->facts.lost_encode)};
    index_seal_entry(entry);
    segment->latency[position] = latency;
}

/*
 * Brings written bytes to the disk. For files that were not prepared, metadata must be written as well, and not all of
 * it belongs to the file. Once this is done, and all blocks are allocated, only the file's own metadata change:
 * fdatasync() writes them without waiting for what other programs have written.
 */
static int sync_fd(struct segment *segment, int fd) {
    bool all = !segment->file.prepared && !segment->settled;
    int error = (all ? syncfs(fd) : fdatasync(fd)) ? -errno : 0;

    if (error)
        *segment->unsafe = true;
    else if (all)
        segment->settled = segment->file.allocated;
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

static int segment_index_flush(struct segment *segment) {
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

static int segment_index_finish(struct segment *segment, bool failed) {
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
    header->lost_encode = index_lost(header->lost_encode, segment->lost_encode);
    /* Entries that were given up may follow the last valid one in its block: write that again without them. */
    int other = write_entries(segment, segment->promised - 1, segment->promised);
    if (!other)
        other = index_mp4_finish(&segment->file, segment->index); /* and its flush, before a header that promises it */
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

#define CHUNK (1u << 20)
#define LOOK_MS 100 /* between checks for a stop while waiting for a pipe */

/* ---- Open ---- */

static int open_plain(const struct output *output, struct segment *segment) {
    struct stat status;

    segment->fd = output_open(output, segment->path);
    if (segment->fd < 0)
        return segment->fd;
    segment->regular = !fstat(segment->fd, &status) && S_ISREG(status.st_mode);
    segment->named = segment->regular && strcmp(output->place, "-") != 0;
    ddx_stats_file(segment->book, segment->regular ? status.st_dev : 0, segment->regular ? status.st_ino : 0);
    return 0;
}

/* Counts frames that a killed predecessor brought to the disk, but did not count. */
static void count_found(struct pool *pool, DDX_STATS_BOOK *book) {
    DDX_STATS stats;

    ddx_stats_get(book, &stats);
    if (stats.died)
        ddx_stats_found(book, pool_recovered_frames(pool, stats.out_sequence));
}

static int open_pooled(const struct output *output, struct pool *pool, uint32_t session, struct segment *segment) {
    segment->latency = calloc(INDEX_ENTRIES, sizeof *segment->latency);
    /* All zeros, and memory for a page is taken with its first entry: the index grows with its recording. */
    void *index = mmap(NULL, sizeof *segment->index, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (index != MAP_FAILED)
        segment->index = index;
    if (!segment->latency || !segment->index)
        return -ENOMEM;
    struct index_header *header = &segment->index->header;
    count_found(pool, segment->book);
    uint32_t number = pool_next_number(pool);
    int error = pool_take(pool, &segment->file);
    if (error)
        return error;
    header->recording = program_random();
    header->state = INDEX_RECORDING;
    header->format = segment->format ? INDEX_MP4 : INDEX_Y4M;
    pool_name(pool, header, output->name, number);
    header->session = session ? session : number;
    snprintf(segment->path, sizeof segment->path, "%s/%s", output->place, header->name);
    segment->pool = pool;
    segment->fd = segment->file.fd;
    segment->regular = true;
    return 0;
}

static void release(struct segment *segment) {
    if (segment->index)
        munmap(segment->index, sizeof *segment->index);
    free(segment->latency);
    free(segment->entries);
    free(segment);
}

int segment_open(const struct output *output, struct pool *pool, DDX_STATS_BOOK *book, const struct mp4_format *format,
                 uint32_t session, struct segment **result) {
    struct segment *segment = calloc(1, sizeof *segment);

    if (!segment)
        return -ENOMEM;
    segment->book = book;
    segment->format = format;
    int error = pool ? open_pooled(output, pool, session, segment) : open_plain(output, segment);
    if (error)
        release(segment);
    else
        *result = segment;
    return error;
}

/* ---- Write ---- */

/*
 * Writes whole blocks, so the first and the last one hold other bytes as well: earlier ones of the file, which the
 * queue still has, and later ones, even while the reading thread puts them there: they are written again with their
 * frame.
 */
static ssize_t write_blocks(struct segment *segment, const unsigned char *bytes, size_t size) {
    size_t before = (size_t)(segment->written % INDEX_BLOCK);
    size_t length = (before + size + INDEX_BLOCK - 1) / INDEX_BLOCK * INDEX_BLOCK;
    ssize_t done = pwrite(segment->fd, bytes - before, length, (off_t)(segment->written - before));

    if (done < 0)
        return -errno;
    if ((size_t)done <= before)
        return -EIO;
    return (size_t)done - before < size ? done - (ssize_t)before : (ssize_t)size;
}

/* Writes to a pipe, which may stay full. */
static ssize_t write_pipe(struct segment *segment, const unsigned char *bytes, size_t size) {
    for (;;) {
        struct pollfd room = {.fd = segment->fd, .events = POLLOUT};

        if (poll(&room, 1, LOOK_MS) > 0) {
            ssize_t done = write(segment->fd, bytes, size);

            if (done >= 0 || (errno != EAGAIN && errno != EINTR))
                return done < 0 ? -errno : done;
        }
        if (program_has_no_patience())
            return -ECANCELED;
    }
}

/* Starts to write back cached bytes, so that the disk works steadily instead of in bursts. */
static int order(struct segment *segment) {
    uint64_t from = segment->ordered, size = segment->written - from;

    if (size < CHUNK)
        return 0;
    segment->ordered = segment->written;
    if (!sync_file_range(segment->fd, (off_t)from, (off_t)size, SYNC_FILE_RANGE_WRITE) ||
        (errno != EIO && errno != ENOSPC && errno != EDQUOT)) /* other errors: the file system does not support it */
        return 0;
    int error = -errno;
    *segment->unsafe = true;
    return error;
}

ssize_t segment_write(struct segment *segment, const unsigned char *bytes, size_t size) {
    ssize_t done;

    do {
        if (segment->file.direct)
            done = write_blocks(segment, bytes, size);
        else if (segment->pool)
            done = pwrite(segment->fd, bytes, size, (off_t)segment->written);
        else if (!segment->regular)
            done = write_pipe(segment, bytes, size);
        else
            done = write(segment->fd, bytes, size);
        if (done < 0 && segment->regular && !segment->file.direct)
            done = -errno;
    } while (done == -EINTR);
    if (done < 0)
        return done;
    segment->written += (uint64_t)done;
    int error = segment->regular && !segment->file.direct ? order(segment) : 0;
    return error ? error : done;
}

/* Notes a frame for the table of an MP4 file: reading all of it again at the end would take minutes. */
static void note_entry(struct segment *segment, const struct frame_queue_frame *frame) {
    uint32_t count = segment->frames;

    if (!segment->named || segment->forgot)
        return;
    if (count == segment->entries_max) {
        uint32_t more = count ? count * 2 : 4096;
        struct mp4_entry *entries = reallocarray(segment->entries, more, sizeof *entries);

        segment->forgot = !entries;
        if (!entries)
            return;
        segment->entries = entries;
        segment->entries_max = more;
    }
    segment->entries[count] =
        (struct mp4_entry){(uint32_t)(frame->end - frame->begin) - MP4_FRAGMENT, frame->facts.step};
}

void segment_add(struct segment *segment, const struct frame_queue_frame *frame, uint32_t sum) {
    int64_t latency = ddx_time_now() - frame->facts.published;

    if (segment->pool)
        segment_index_add(segment, frame, sum, latency);
    else
        ddx_stats_out(segment->book, 1, latency);
    if (segment->format)
        note_entry(segment, frame);
    segment->adding++;
    segment->whole = frame->end - segment->begin;
    segment->frames++; /* after the entry, so that a thread that reads the count finds the entry */
    segment->adding++;
}

/* ---- Flush ---- */

/* A file without a name is deleted when it is closed. */
static bool is_removed(const struct segment *segment) {
    struct stat status;

    return segment->regular && !fstat(segment->fd, &status) && !status.st_nlink;
}

static int flush_plain(struct segment *segment) {
    uint32_t frames;
    uint64_t whole;
    unsigned adding;

    do {
        adding = segment->adding;
        frames = segment->frames;
        whole = segment->whole;
    } while (adding % 2 || adding != segment->adding);
    if (!segment->regular)
        return 0;
    if (is_removed(segment)) {
        segment->safe = segment->safe_frames = 0;
        return -EIDRM;
    }
    if (frames == segment->safe_frames)
        return 0;
    int error = *segment->unsafe ? -EIO : fdatasync(segment->fd) ? -errno : 0;
    if (error) {
        *segment->unsafe = true;
        return error;
    }
    segment->safe_frames = frames;
    segment->safe = whole;
    return 0;
}

int segment_flush(struct segment *segment) {
    int error = is_removed(segment) && segment->pool ? -EIDRM : 0;

    if (!error)
        error = segment->pool ? segment_index_flush(segment) : flush_plain(segment);
    return error;
}

bool segment_is_promised(const struct segment *segment) {
    return !segment->pool || segment->promised;
}

/* Removes its name, unless another file has that name by now. */
static void unlink_own(const struct segment *segment) {
    struct stat own, named;

    if (!fstat(segment->fd, &own) && !lstat(segment->path, &named) && own.st_ino == named.st_ino &&
        own.st_dev == named.st_dev)
        unlink(segment->path);
}

/* Cuts off frames that are incomplete, or that the disk did not take. */
static void cut(struct segment *segment) {
    ddx_stats_take_back(segment->book, LOST_WRITE, segment->frames - segment->safe_frames);
    if (!segment->safe)
        unlink_own(segment); /* no frame: an empty file is of no use */
    else if (ftruncate(segment->fd, (off_t)segment->safe) || fdatasync(segment->fd))
        say("%s: cannot be cut after its last good frame, number %u: %s", segment->path, segment->safe_frames,
            strerror(errno));
}

/* Makes a plain MP4 file of fragments. If that fails, they remain: the next recorder tries again. */
static int write_table(struct segment *segment) {
    int64_t bytes =
        segment->forgot ? -ENOMEM : mp4_finish(segment->fd, segment->format, segment->entries, segment->safe_frames);
    int error = bytes < 0 ? (int)bytes : 0;

    if (error) {
        say("%s: has no table, so players cannot seek in it, %s; start the recorder again to add it", segment->path,
            strerror(-error));
        if (ftruncate(segment->fd, (off_t)segment->safe))
            *segment->unsafe = true;
    }
    return error;
}

static int finish_plain(struct segment *segment, bool failed) {
    int error = segment_flush(segment); /* also after a failed write: complete frames may still get to the disk */

    if (segment->regular && (failed || error))
        cut(segment);
    if (segment->format && segment->named && segment->safe_frames && !*segment->unsafe && error != -EIDRM) {
        int other = write_table(segment);

        error = error ? error : other;
    }
    if (close(segment->fd) && !error)
        error = -errno;
    return error;
}

int segment_finish(struct segment *segment, bool failed) {
    int error = segment->pool ? segment_index_finish(segment, failed) : finish_plain(segment, failed);

    release(segment);
    return error;
}
