/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "find_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "pool_files.h"
#include "pool_names.h"
#include "schedule.h"
#include "y4m.h"

#define NS INT64_C(1000000000)

/* A frame lasts until the next one, the last one as long as the others. */
static int64_t lasts(int64_t first, int64_t last, uint64_t frames) {
    return frames < 2 || last < first ? 0 : (last - first) / (int64_t)(frames - 1) * (int64_t)frames;
}

int find_open(int folder, const char *name, int flags) {
    struct stat status;
    int fd = openat(folder, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | flags);

    if (fd < 0)
        return -errno;
    if (!fstat(fd, &status) && S_ISREG(status.st_mode))
        return fd;
    close(fd);
    return -EBADF;
}

/* ---- With an index ---- */

/* The header has no counts yet. */
static void count_so_far(int fd, struct found *found) {
    struct index_file *index = malloc(sizeof *index);

    if (!index || index_read(fd, index)) {
        free(index);
        return;
    }
    found->frames = index_count(index, UINT64_MAX);
    for (uint64_t i = 0; i < found->frames; i++) {
        found->lost_store += index->entry[i].lost_store;
        found->lost_ring += index->entry[i].lost_ring;
        found->bytes = index->entry[i].offset + index->entry[i].bytes;
        found->duration = lasts(index->header.start, index->entry[i].time, found->frames);
    }
    free(index);
}

static void read_length(int fd, const struct index_header *header, struct found *found) {
    struct index_entry last;
    off_t at = (off_t)(INDEX_BLOCK + (header->frames - 1) * sizeof last);

    if (header->frames && pread(fd, &last, sizeof last, at) == (ssize_t)sizeof last &&
        index_good_entry(&last, header->recording, header->frames - 1))
        found->duration = lasts(header->start, last.time, header->frames);
}

bool find_indexed(int pool, bool named, struct found *found) {
    char name[POOL_PATH];
    struct index_header header;

    pool_index_name(name, found->id);
    int fd = find_open(pool, name, 0);
    bool good = fd >= 0 && pool_read_header(fd, &header) && header.state >= INDEX_RECORDING &&
                (named || header.state != INDEX_NAMED);
    if (good) {
        strcpy(found->name, header.name);
        strcpy(found->item, header.item);
        found->recording = header.recording;
        found->number = header.number;
        found->session = header.session ? header.session : header.number;
        found->wall = header.wall;
        found->frames = header.frames;
        found->bytes = header.bytes;
        found->lost_store = header.lost_store;
        found->lost_ring = header.lost_ring;
        found->state = header.flags & INDEX_RECOVERED ? FOUND_RECOVERED : FOUND_FINISHED;
    }
    if (good && !named)
        found->state = pool_is_locked(pool, found->id) ? FOUND_RECORDING : FOUND_INTERRUPTED;
    if (good && header.state == INDEX_RECORDING)
        count_so_far(fd, found);
    else if (good)
        read_length(fd, &header, found);
    if (fd >= 0)
        close(fd);
    return good;
}

/* ---- Without ---- */

/* <item>-<number>-<UTC>.y4m; another name is an item without a number. */
static void read_name(struct found *found) {
    struct tm utc = {.tm_year = 0};
    const char *end = pool_name_number(found->name, &found->number);

    if (end && strptime(strrchr(end, '-') + 1, "%Y%m%dT%H%M%SZ", &utc))
        found->wall = (int64_t)timegm(&utc) * NS;
    if (!end)
        end = found->name + strlen(found->name) - strlen(".y4m");
    size_t length = (size_t)(end - found->name);
    if (length >= sizeof found->item)
        length = sizeof found->item - 1;
    memcpy(found->item, found->name, length);
    found->item[length] = 0;
    found->session = found->number;
}

/* The line at an offset, without its line feed; its length with it, 0 if there is none. */
static size_t read_line(int fd, uint64_t at, char line[Y4M_HEADER_MAX]) {
    ssize_t got = pread(fd, line, Y4M_HEADER_MAX - 1, (off_t)at);

    if (got <= 0)
        return 0;
    line[got] = 0;
    char *end = strchr(line, '\n');
    if (!end)
        return 0;
    *end = 0;
    return (size_t)(end - line) + 1;
}

/* Reads the FRAME lines, and skips the pictures. */
static void walk(int fd, const struct y4m_header *header, uint64_t at, struct found *found) {
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    uint64_t picture = 0;
    int64_t time, last = -1;
    size_t length;

    for (int plane = 0; plane < 4; plane++)
        picture += y4m_plane_bytes(header, plane);
    while (at < found->bytes && (length = read_line(fd, at, line)) && y4m_parse_frame(line, &time, error) &&
           found->bytes - at >= length + picture) {
        at += length + picture;
        found->frames++;
        last = time;
    }
    if (at < found->bytes)
        found->state = FOUND_CUT_OFF;
    if (last >= 0)
        found->duration = lasts(0, last, found->frames);
    else if (header->geometry.rate_num)
        found->duration = schedule_offset(found->frames, (uint32_t)header->geometry.rate_num,
                                          (uint32_t)header->geometry.rate_den);
}

bool find_plain(int folder, struct found *found) {
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    struct y4m_header header;
    struct stat status;
    int fd = find_open(folder, found->name, 0);

    if (fd < 0 || fstat(fd, &status)) {
        if (fd >= 0)
            close(fd);
        return false;
    }
    size_t length = read_line(fd, 0, line);
    bool good = length && y4m_parse_header(line, Y4M_SAME, &header, error);
    read_name(found);
    found->bytes = (uint64_t)status.st_size;
    posix_fadvise(fd, 0, 0, POSIX_FADV_RANDOM); /* do not read ahead into the pictures */
    if (good)
        walk(fd, &header, length, found);
    else
        found->state = FOUND_CUT_OFF;
    close(fd);
    return good || (found->number && found->bytes); /* only a recorder makes such names */
}
