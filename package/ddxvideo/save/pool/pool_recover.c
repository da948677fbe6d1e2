/* SPDX-License-Identifier: GPL-2.0-or-later */
/* After a power cut or a kill, each recording ends with the last frame in its index. */
#include "pool_recover.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "crc32c.h"
#include "index_mp4.h"
#include "pool_files.h"
#include "pool_names.h"
#include "program.h"

#define LOOKED_AT 32 /* last frames that are verified: a disk may lack frames that it reported as written */

struct recovering {
    struct index_file *index;
    int error;
};

static bool is_whole(const struct pool_file *file, const struct index_entry *entry) {
    uint64_t begin = entry->offset / INDEX_BLOCK * INDEX_BLOCK, end = entry->offset + entry->bytes;
    size_t size = (size_t)((end - begin + INDEX_BLOCK - 1) / INDEX_BLOCK * INDEX_BLOCK);
    unsigned char *bytes;

    if (posix_memalign((void **)&bytes, INDEX_BLOCK, size))
        return false;
    ssize_t got = pread(file->fd, bytes, size, (off_t)begin);
    bool whole =
        got >= (ssize_t)(end - begin) && crc32c(0, bytes + (entry->offset - begin), entry->bytes) == entry->sum;
    free(bytes);
    return whole;
}

/* The number of frames before the first one that does not match the index. */
static uint32_t whole_frames(const struct pool_file *file, const struct index_file *index) {
    struct stat status;

    if (fstat(file->fd, &status))
        return 0;
    uint32_t count = index_count(index, (uint64_t)status.st_size);
    for (uint32_t i = count > LOOKED_AT ? count - LOOKED_AT : 0; i < count; i++)
        if (!is_whole(file, &index->entry[i]))
            return i;
    return count;
}

static int finish(struct pool *pool, struct pool_file *file, struct index_file *index, uint32_t frames) {
    struct index_header *header = &index->header;

    index_end(index, frames);
    header->flags |= INDEX_RECOVERED;
    int error = index_mp4_finish(file, index);
    if (error == -EBADMSG || error == -ENOSPC) {
        say("%s: has no table, so players cannot seek in it: %s", header->name,
            error == -ENOSPC ? strerror(-error) : "its first block is damaged");
        error = 0;
    }
    if (!error)
        error = pool_write_header(file, header);
    if (!error && fsync(file->index_fd))
        error = -errno;
    if (error) {
        pool_release(file);
        return error;
    }
    return pool_finish_locked(pool, file, header, true);
}

static bool recover(struct pool *pool, long id, void *argument) {
    struct recovering *recovering = argument;
    struct pool_file file;
    struct index_header header;

    if (pool_is_named(pool, id) || !pool_claim(pool, id, &file, &header))
        return true;
    if (header.state != INDEX_RECORDING && header.state != INDEX_FINISHED) {
        pool_release(&file);
        return true;
    }
    uint32_t frames = 0;
    const char *recording = recovering->index->header.name;
    int error = index_read(file.index_fd, recovering->index);
    if (!error)
        frames = whole_frames(&file, recovering->index);
    if (frames) {
        error = finish(pool, &file, recovering->index, frames);
        if (!error)
            say("%s: not finished when it was last recorded to; it ends after %u whole frames now", recording, frames);
    } else {
        file.prepared = false; /* its size is checked on preparation */
        pool_give_back(&file);
    }
    if (error && !recovering->error)
        recovering->error = error;
    return true;
}

int pool_recover(struct pool *pool) {
    struct recovering recovering = {.error = 0};

    if (posix_memalign((void **)&recovering.index, INDEX_BLOCK, sizeof *recovering.index))
        return -ENOMEM;
    pool_lock(pool);
    int error = pool_each(pool, recover, &recovering);
    pool_unlock(pool);
    free(recovering.index);
    return error ? error : recovering.error;
}

/* ---- Count of recovered frames ---- */

struct counting {
    const char *instance;
    uint64_t above, frames;
    struct index_header newest, before; /* of its two newest files; number 0: none */
    struct index_file *index;
};

/* Opens the index of a file of this instance, and reads its header. -1: not a file of this instance. */
static int open_own(struct pool *pool, long id, const char *instance, struct index_header *header) {
    char name[POOL_PATH];

    pool_index_name(name, id);
    int fd = openat(pool->folder, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0 || (pool_read_header(fd, header) && header->number && !strcmp(header->instance, instance)))
        return fd;
    close(fd);
    return -1;
}

static bool find_newest(struct pool *pool, long id, void *argument) {
    struct counting *counting = argument;
    struct index_header header;
    int fd = open_own(pool, id, counting->instance, &header);

    if (fd < 0)
        return true;
    close(fd);
    if (header.number > counting->newest.number) {
        counting->before = counting->newest;
        counting->newest = header;
    } else if (header.number > counting->before.number) {
        counting->before = header;
    }
    return true;
}

/* The last two files count: a recording may just have begun the next one, and other recorders may have taken numbers in
 * between. Frames of another item have other numbers. */
static bool is_wanted(const struct counting *counting, const struct index_header *header) {
    return header->flags & INDEX_RECOVERED && !strcmp(header->item, counting->newest.item) &&
           (header->number == counting->newest.number || header->number == counting->before.number);
}

static bool count(struct pool *pool, long id, void *argument) {
    struct counting *counting = argument;
    struct index_header header;
    int fd = open_own(pool, id, counting->instance, &header);

    if (fd < 0)
        return true;
    if (is_wanted(counting, &header) && !index_read(fd, counting->index))
        for (uint32_t i = 0; i < header.frames && i < INDEX_ENTRIES; i++)
            counting->frames += counting->index->entry[i].sequence > counting->above;
    close(fd);
    return true;
}

uint64_t pool_recovered_frames(struct pool *pool, uint64_t above) {
    struct counting counting = {.instance = pool->instance, .above = above};

    pool_wait_for_recovery(pool);
    pool_lock(pool);
    pool_each(pool, find_newest, &counting);
    if (!posix_memalign((void **)&counting.index, INDEX_BLOCK, sizeof *counting.index))
        pool_each(pool, count, &counting);
    pool_unlock(pool);
    free(counting.index);
    return counting.frames;
}
