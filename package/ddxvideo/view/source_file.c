/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A Y4M or MP4 file, or the files of a recording. Each picture of Y4M is one read, at any position. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "decoded.h"
#include "frames.h"
#include "mp4_read.h"
#include "picture_convert.h"
#include "program.h"
#include "source.h"
#include "video_layout.h"

struct file_source {
    struct source source;
    struct frames frames;
    struct shot_pool pool;
    uint64_t limit; /* bytes of kept pictures */
    /* the file of the last read */
    int fd; /* -1: none */
    unsigned part;
    bool is_mp4;
    struct decoded decoded;              /* of an MP4 file */
    struct y4m_header header;            /* of a Y4M file */
    struct picture_converter *converter; /* NULL: its planes are like the store's */
    char wrong[Y4M_ERROR_MAX];           /* why the last picture could not be read, or "" */
};

static void file_range(struct source *source, int64_t *oldest, int64_t *newest) {
    *oldest = 0;
    *newest = ((struct file_source *)source)->frames.count - 1;
}

static int64_t file_time(struct source *source, int64_t position) {
    struct frames *frames = &((struct file_source *)source)->frames;

    return position >= 0 && position < frames->count ? frames->entry[position].time : 0;
}

static void file_work(struct source *source) {
    struct file_source *from = (struct file_source *)source;
    struct frames *frames = &from->frames;

    if (frames_work(frames)) {
        snprintf(frames->text, sizeof frames->text, "out of memory: only the first frames are shown");
        frames->complete = true;
    }
    if (from->is_mp4 && frames->complete)
        decoded_prepare(&from->decoded, frames);
}

static void file_state(struct source *source, struct source_state *state) {
    struct file_source *from = (struct file_source *)source;
    const struct ddxvideo_geometry *geometry = from->is_mp4 ? &from->decoded.geometry : &from->header.geometry;

    *state = (struct source_state){.working = !from->frames.complete,
                                   .preparing = from->is_mp4 && from->frames.complete &&
                                                decoded_can_prepare(&from->decoded, &from->frames),
                                   .lost = from->frames.lost};
    if (geometry->rate_den)
        state->rate = (double)geometry->rate_num / geometry->rate_den;
    snprintf(state->text, sizeof state->text, "%.119s", *from->wrong ? from->wrong : from->frames.text);
}

static void close_part(struct file_source *from) {
    if (from->is_mp4)
        decoded_close(&from->decoded);
    from->is_mp4 = false;
    picture_converter_free(from->converter);
    from->converter = NULL;
    if (from->fd >= 0)
        close(from->fd);
    from->fd = -1;
}

static void file_close(struct source *source) {
    struct file_source *from = (struct file_source *)source;

    close_part(from);
    frames_close(&from->frames);
    shot_pool_close(&from->pool);
    free(from);
}

/* ---- Pictures ---- */

static bool open_y4m(struct file_source *from) {
    if (!frames_header(from->fd, &from->header, from->wrong))
        return false;
    if (y4m_is_plain(&from->header) || (from->converter = y4m_converter(&from->header)))
        return true;
    snprintf(from->wrong, sizeof from->wrong, "C%s cannot be converted to 4:2:0", from->header.layout->tag);
    return false;
}

/* Opens a part, and reads its header. False, with a text in `wrong`. */
static bool open_part(struct file_source *from, unsigned part) {
    const char *path = from->frames.part[part].path;
    struct stat status;
    bool opened = false;

    if (from->fd >= 0 && from->part == part)
        return true;
    close_part(from);
    from->part = part;
    from->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY); /* do not wait for a pipe */
    if (from->fd < 0 || fstat(from->fd, &status)) {
        snprintf(from->wrong, sizeof from->wrong, "cannot be opened: %s", strerror(errno));
    } else if (!S_ISREG(status.st_mode)) {
        snprintf(from->wrong, sizeof from->wrong, "no regular file");
    } else {
        from->is_mp4 = mp4_is_any(from->fd);
        opened = from->is_mp4 ? decoded_open(&from->decoded, from->fd, &from->pool, from->limit, from->wrong)
                              : open_y4m(from);
    }
    if (!opened)
        close_part(from);
    return opened;
}

static size_t picture_bytes(const struct file_source *from) {
    size_t bytes = 0;

    for (int plane = 0; plane < 4; plane++)
        bytes += y4m_plane_bytes(&from->header, plane);
    return bytes;
}

/* Takes the planes from the bytes of a read. False: not a frame. */
static bool find_planes(struct file_source *from, struct shot *shot, size_t bytes, unsigned char *converted) {
    const unsigned char *end = memchr(shot->memory, '\n', bytes < Y4M_FRAME_LINE_MAX ? bytes : Y4M_FRAME_LINE_MAX);

    if (!end || strncmp((const char *)shot->memory, "FRAME", 5) ||
        (size_t)(end + 1 - shot->memory) + picture_bytes(from) != bytes)
        return false;
    unsigned char *start = shot->memory + (end + 1 - shot->memory);
    shot->picture.geometry = from->header.geometry;
    if (!from->converter) {
        video_layout_place(&shot->picture, start);
        return true;
    }
    video_layout_place(&shot->picture, converted);
    unsigned char *planes[3] = {converted, converted + (shot->picture.plane[1] - shot->picture.plane[0]),
                                converted + (shot->picture.plane[2] - shot->picture.plane[0])};
    return y4m_convert(&from->header, from->converter, start, planes);
}

static struct shot *read_shot(struct file_source *from, const struct frames_entry *entry) {
    size_t most = Y4M_FRAME_LINE_MAX + picture_bytes(from); /* an index may have any number */

    if (entry->bytes > most) {
        snprintf(from->wrong, sizeof from->wrong, "frame %d: damaged", entry->number);
        return NULL;
    }
    size_t before = (entry->bytes + PICTURE_READ_BEYOND + 63) / 64 * 64;
    size_t converted = from->converter ? video_layout_bytes(&from->header.geometry) : 0;
    struct shot *shot = shot_new(&from->pool, before + converted);

    if (!shot) {
        snprintf(from->wrong, sizeof from->wrong, "out of memory");
        return NULL;
    }
    ssize_t got = pread(from->fd, shot->memory, entry->bytes, (off_t)entry->offset);
    if (got != (ssize_t)entry->bytes || !find_planes(from, shot, (size_t)got, shot->memory + before)) {
        snprintf(from->wrong, sizeof from->wrong, "frame %d: %s", entry->number, got < 0 ? strerror(errno) : "damaged");
        shot_drop(shot);
        return NULL;
    }
    return shot;
}

static struct shot *file_take(struct source *source, int64_t position) {
    struct file_source *from = (struct file_source *)source;

    if (position < 0 || position >= from->frames.count)
        return NULL;
    const struct frames_entry *entry = &from->frames.entry[position];
    *from->wrong = 0;
    if (!open_part(from, entry->part))
        return NULL;
    struct shot *shot =
        from->is_mp4 ? decoded_take(&from->decoded, &from->frames, position, from->wrong) : read_shot(from, entry);
    if (!shot)
        return NULL;
    shot->picture.stamp = (struct ddxvideo_stamp){
        .frame = entry->number, .time = entry->time, .wall_offset = from->frames.part[entry->part].wall_offset};
    shot->missing = entry->missing;
    return shot;
}

/* ---- Start ---- */

/* False, after a line: the file has no picture to show. */
static bool begin(struct file_source *from, const char *path) {
    int error = frames_open(&from->frames, path);

    if (error)
        snprintf(from->wrong, sizeof from->wrong, "%s", strerror(-error));
    else if (open_part(from, 0)) {
        file_work(&from->source);
        if (from->frames.count)
            return true;
        snprintf(from->wrong, sizeof from->wrong, "holds no frame; record or copy it again");
    }
    say("%s: %s", path, from->wrong);
    return false;
}

struct source *source_file(const char *path, uint64_t limit, int *status) {
    struct file_source *from = calloc(1, sizeof *from);

    if (!from) {
        say("out of memory");
        *status = EXIT_FAILED;
        return NULL;
    }
    from->fd = -1;
    from->limit = limit;
    shot_pool_open(&from->pool, UINT64_MAX);
    from->source = (struct source){.range = file_range,
                                   .take = file_take,
                                   .time = file_time,
                                   .work = file_work,
                                   .state = file_state,
                                   .close = file_close};
    if (begin(from, path)) {
        snprintf(from->source.name, sizeof from->source.name, "%s", from->frames.name);
        return &from->source;
    }
    file_close(&from->source);
    *status = EXIT_USAGE;
    return NULL;
}
