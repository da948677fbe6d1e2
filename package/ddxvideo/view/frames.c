/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frames.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <libgen.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "find.h"
#include "index.h"
#include "mp4_read.h"
#include "pool_files.h"
#include "schedule.h"
#include "stamp.h"

/* ---- The frames of one file ---- */

#define USUAL_RATE 25 /* if the file has no rate */
#define LINES 256     /* FRAME lines that are read in one step */
#define FIRST_ROOM 1024
#define NO_Y4M "no Y4M file; make one: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m"

size_t frames_header(int fd, struct y4m_header *header, char *error) {
    char line[Y4M_HEADER_MAX + 1];
    ssize_t got = pread(fd, line, Y4M_HEADER_MAX, 0);
    char *end = got > 0 ? memchr(line, '\n', (size_t)got) : NULL;

    if (got < 0)
        snprintf(error, Y4M_ERROR_MAX, "cannot be read: %s", strerror(errno));
    else if (!got)
        snprintf(error, Y4M_ERROR_MAX, "is empty; record or copy it again");
    else if (!end)
        snprintf(error, Y4M_ERROR_MAX, NO_Y4M);
    if (!end)
        return 0;
    *end = 0;
    if (memchr(line, 0, (size_t)(end - line))) {
        snprintf(error, Y4M_ERROR_MAX, NO_Y4M);
        return 0;
    }
    return y4m_parse_header(line, DDX_VIDEO_420, header, error) ? (size_t)(end - line) + 1 : 0;
}

static int frames_add(struct frames *frames, const struct frames_entry *entry) {
    if (frames->count == frames->room) {
        int64_t room = frames->room ? 2 * frames->room : FIRST_ROOM;
        struct frames_entry *more = realloc(frames->entry, (size_t)room * sizeof *more);

        if (!more)
            return -ENOMEM;
        frames->entry = more;
        frames->room = room;
    }
    frames->entry[frames->count++] = *entry;
    frames->lost += entry->missing;
    return 0;
}

static uint32_t small(uint64_t count) {
    return count > UINT32_MAX ? UINT32_MAX : (uint32_t)count;
}

static void say_short(struct frames *frames, const struct frames_part *part, uint64_t cut) {
    const char *name = strrchr(part->path, '/');

    snprintf(frames->text, sizeof frames->text, "%.70s: cut short, %" PRIu64 " frames are missing",
             name ? name + 1 : part->path, cut);
}

/* ---- By its index ---- */

/* Frames that are missing before this one; before the first of a part there may be more than its index has. */
static uint32_t missing_before(struct frames *frames, const struct frames_part *part, const struct index_entry *entry,
                               bool first) {
    uint64_t missing = (uint64_t)entry->lost_store + entry->lost_ring + entry->lost_encode, gap = 0;
    uint64_t step = entry->sequence > frames->sequence ? entry->sequence - frames->sequence : 1;

    if (first && frames->count && !part->follows) /* files between these two may have been deleted */
        gap = step / frames->step - (step >= frames->step);
    if (first)
        missing += frames->cut;
    else /* a recorder may skip frames on request */
        frames->step = step / (missing + 1) ? step / (missing + 1) : 1;
    frames->sequence = entry->sequence;
    return small(gap > missing ? gap : missing);
}

static int take_index(struct frames *frames, struct frames_part *part, const struct index_file *index, uint64_t bytes) {
    const struct index_header *header = &index->header;
    uint32_t promised = index_count(index, UINT64_MAX), count = index_count(index, bytes);
    uint32_t all = header->state >= INDEX_FINISHED && header->frames > promised ? header->frames : promised;
    int error = 0;

    if (header->state >= INDEX_FINISHED && header->frames < count)
        all = count = header->frames; /* the entries after these belong to an older recording with that number */
    part->wall_offset = header->wall ? header->wall - header->start : 0;
    for (uint32_t i = 0; i < count && !error; i++) {
        const struct index_entry *from = &index->entry[i];

        error = frames_add(frames, &(struct frames_entry){.offset = from->offset,
                                                          .time = from->time,
                                                          .bytes = from->bytes,
                                                          .part = frames->next,
                                                          .missing = missing_before(frames, part, from, !i),
                                                          .number = from->frame,
                                                          .key = from->flags & INDEX_KEY});
    }
    frames->cut = all - count;
    if (frames->cut)
        say_short(frames, part, frames->cut);
    return error;
}

static int read_open(struct frames *frames, struct frames_part *part, int fd, struct index_file *index) {
    struct stat data;

    if (index_read(fd, index) || stat(part->path, &data))
        return -EBADMSG;
    return take_index(frames, part, index, (uint64_t)data.st_size);
}

/* 0: all of the index was read. -ENOMEM; -EBADMSG: it is damaged or cannot be read. */
static int frames_index_read(struct frames *frames, struct frames_part *part) {
    int fd = open(part->index, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    struct index_file *index = malloc(sizeof *index);
    int error = !index ? -ENOMEM : fd < 0 ? -EBADMSG : read_open(frames, part, fd, index);

    free(index);
    if (fd >= 0)
        close(fd);
    return error;
}

/* ---- By its FRAME lines, or its fragments ---- */

struct frames_scan {
    int fd;
    bool is_mp4;
    struct mp4_file mp4;
    uint64_t at, bytes, picture; /* of a Y4M file; at == bytes: no more frames, in each case */
    int64_t begin;               /* time of the first frame */
    int64_t first;               /* its number */
    uint32_t rate_num, rate_den;
};

static void frames_scan_end(struct frames *frames) {
    if (!frames->scan)
        return;
    close(frames->scan->fd);
    free(frames->scan);
    frames->scan = NULL;
}

static int scan_begin(struct frames *frames, const struct frames_part *part) {
    char error[Y4M_ERROR_MAX];
    struct y4m_header header;
    struct stat status;
    struct frames_scan *scan = calloc(1, sizeof *scan);

    if (!scan)
        return -ENOMEM;
    scan->fd = open(part->path, O_RDONLY | O_CLOEXEC);
    frames->scan = scan;
    if (scan->fd < 0 || fstat(scan->fd, &status))
        return 0; /* nothing more to read: the next file */
    scan->first = frames->count;
    posix_fadvise(scan->fd, 0, 0, POSIX_FADV_RANDOM); /* read the lines, not the pictures between them */
    scan->is_mp4 = mp4_is_any(scan->fd);
    if (scan->is_mp4) {
        scan->bytes = !mp4_open(&scan->mp4, scan->fd);
        return 0;
    }
    scan->at = frames_header(scan->fd, &header, error);
    scan->bytes = scan->at ? (uint64_t)status.st_size : 0;
    for (int plane = 0; plane < 4 && scan->at; plane++)
        scan->picture += y4m_plane_bytes(&header, plane);
    bool known = scan->at && header.geometry.rate_num;
    scan->rate_num = known ? (uint32_t)header.geometry.rate_num : USUAL_RATE;
    scan->rate_den = known ? (uint32_t)header.geometry.rate_den : 1;
    return 0;
}

/* The wall time of a recording's first frame, ns, or 0. */
static int64_t wall_of(const char *line) {
    const char *word = strstr(line, " XDDX_WALL=");

    return word ? strtoll(word + strlen(" XDDX_WALL="), NULL, 10) : 0;
}

/* How a file's frames end before its end. */
static void end_early(struct frames *frames, bool cut) {
    snprintf(frames->text, sizeof frames->text, "%s after frame %" PRId64, cut ? "cut short" : "damaged",
             frames->count - 1);
    frames->scan->at = frames->scan->bytes;
}

/* Takes the frame whose line is at the current position. The line's length, 0 if there is none. */
static size_t scan_line(struct frames *frames, struct frames_part *part, struct frames_entry *entry) {
    struct frames_scan *scan = frames->scan;
    char line[Y4M_FRAME_LINE_MAX + 1], error[Y4M_ERROR_MAX];
    ssize_t got = pread(scan->fd, line, Y4M_FRAME_LINE_MAX, (off_t)scan->at);
    char *end = got > 0 ? memchr(line, '\n', (size_t)got) : NULL;
    int64_t time, number = frames->count - scan->first;

    if (!end)
        return 0;
    *end = 0;
    if (!y4m_parse_frame(line, &time, error))
        return 0;
    if (!number && y4m_parse_start(line) > 0) {
        scan->begin = y4m_parse_start(line);
        part->wall_offset = wall_of(line) > 0 ? wall_of(line) - scan->begin : 0;
    }
    *entry = (struct frames_entry){.offset = scan->at, .part = frames->next, .number = (int32_t)number};
    entry->time = scan->begin + (time >= 0 ? time : schedule_offset((uint64_t)number, scan->rate_num, scan->rate_den));
    entry->bytes = (uint32_t)((uint64_t)(end - line) + 1 + scan->picture);
    return (size_t)(end - line) + 1;
}

static int scan_y4m(struct frames *frames, struct frames_part *part) {
    struct frames_scan *scan = frames->scan;
    struct frames_entry entry;
    size_t line = scan_line(frames, part, &entry);

    if (!line || scan->bytes - scan->at < entry.bytes) {
        end_early(frames, line);
        return 0;
    }
    scan->at += entry.bytes;
    return frames_add(frames, &entry);
}

/* The stamp of the fragment that was found last. */
static bool read_stamp(const struct frames_scan *scan, const struct mp4_fragment *fragment, struct stamp *stamp) {
    uint8_t begin[STAMP_NAL_MAX];
    size_t size = fragment->bytes < sizeof begin ? fragment->bytes : sizeof begin;
    ssize_t got = pread(scan->fd, begin, size, (off_t)(scan->mp4.at - fragment->bytes));

    return got == (ssize_t)size && stamp_read(begin, size, stamp);
}

static int scan_mp4(struct frames *frames, struct frames_part *part) {
    struct frames_scan *scan = frames->scan;
    struct mp4_fragment fragment;
    struct stamp stamp;
    enum mp4_next next = mp4_next_frame(&scan->mp4, &fragment);

    if (next == MP4_END)
        scan->at = scan->bytes;
    else if (next != MP4_FRAME || !read_stamp(scan, &fragment, &stamp))
        end_early(frames, next == MP4_CUT);
    if (scan->at == scan->bytes)
        return 0;
    if (fragment.number == 1 && stamp.time > 0) {
        scan->begin = stamp.time;
        part->wall_offset = stamp.wall ? stamp.wall - stamp.time : 0;
    }
    /* By the times that players show, which never go back. */
    int64_t time, shown = fragment.time <= INT64_MAX / 1000 ? (int64_t)fragment.time * 1000 : INT64_MAX;
    if (__builtin_add_overflow(scan->begin, shown, &time))
        time = INT64_MAX;
    return frames_add(frames, &(struct frames_entry){
                                  .offset = scan->mp4.at - fragment.bytes - MP4_FRAGMENT,
                                  .time = time,
                                  .bytes = fragment.bytes + MP4_FRAGMENT,
                                  .part = frames->next,
                                  .missing = small((uint64_t)stamp.lost_store + stamp.lost_ring + stamp.lost_encode),
                                  .number = (int32_t)stamp.frame,
                                  .key = fragment.key});
}

/* Read the next FRAME lines or fragments. 1: there are more; 0: there are no more; -ENOMEM. */
static int frames_scan(struct frames *frames, struct frames_part *part) {
    int error = frames->scan ? 0 : scan_begin(frames, part);
    struct frames_scan *scan = frames->scan;

    for (int i = 0; i < LINES && !error && scan->at < scan->bytes; i++)
        error = scan->is_mp4 ? scan_mp4(frames, part) : scan_y4m(frames, part);
    if (!error && scan->at < scan->bytes)
        return 1;
    frames_scan_end(frames);
    return error;
}

/* ---- The frames of all files ---- */

#define SLICE INT64_C(5000000) /* ns */

static int add_part(struct frames *frames, const struct frames_part *part) {
    struct frames_part *more = realloc(frames->part, (frames->parts + 1) * sizeof *more);

    if (more)
        frames->part = more;
    if (!more || !part->path) {
        free(part->path);
        free(part->index);
        return -ENOMEM;
    }
    more[frames->parts++] = *part;
    return 0;
}

static char *join(const char *folder, const char *name) {
    char *path = NULL;

    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

/* The files of this file's recording, in order. */
static int add_recording(struct frames *frames, const char *path, const struct folder *folder,
                         const struct found *chosen) {
    unsigned number = chosen->number;
    int error = 0;

    for (unsigned i = 0; i < folder->count && !error; i++) {
        const struct found *found = &folder->file[i];
        char data[POOL_PATH], index[POOL_PATH], pool[PATH_MAX];

        if (!found->id || found->session != chosen->session || strcmp(found->item, chosen->item))
            continue;
        pool_data_name(data, found->id);
        pool_index_name(index, found->id);
        snprintf(pool, sizeof pool, "%s/" POOL_FOLDER, path);
        bool named = found->state < FOUND_INTERRUPTED;
        error = add_part(frames, &(struct frames_part){.path = named ? join(path, found->name) : join(pool, data),
                                                       .index = join(pool, index),
                                                       .follows = frames->parts && found->number == number + 1});
        number = found->number;
    }
    snprintf(frames->name, sizeof frames->name, "%.63s", chosen->item);
    return error;
}

/* True: the file belongs to a recording with an index. */
static bool find_recording(struct frames *frames, const char *path, int *error) {
    char folder_copy[PATH_MAX], name_copy[PATH_MAX], pool[PATH_MAX + 8];
    struct folder folder;

    snprintf(folder_copy, sizeof folder_copy, "%s", path);
    snprintf(name_copy, sizeof name_copy, "%s", path);
    const char *where = dirname(folder_copy), *name = basename(name_copy);
    snprintf(pool, sizeof pool, "%s/" POOL_FOLDER, where);
    if (access(pool, R_OK | X_OK)) /* not a recorder's folder: ignore other files in it */
        return false;
    const struct found *chosen = NULL;
    if (!folder_open(&folder, where))
        for (unsigned i = 0; i < folder.count; i++)
            if (folder.file[i].id && !strcmp(folder.file[i].name, name))
                chosen = &folder.file[i];
    if (chosen)
        *error = add_recording(frames, where, &folder, chosen);
    folder_close(&folder);
    return chosen;
}

int frames_open(struct frames *frames, const char *path) {
    char copy[PATH_MAX];
    int error = 0;

    *frames = (struct frames){.step = 1};
    if (find_recording(frames, path, &error))
        return error;
    snprintf(copy, sizeof copy, "%s", path);
    snprintf(frames->name, sizeof frames->name, "%.63s", basename(copy));
    char *end = strrchr(frames->name, '.');
    if (end && end != frames->name)
        *end = 0;
    return add_part(frames, &(struct frames_part){.path = strdup(path)});
}

void frames_close(struct frames *frames) {
    frames_scan_end(frames);
    for (unsigned i = 0; i < frames->parts; i++) {
        free(frames->part[i].path);
        free(frames->part[i].index);
    }
    free(frames->part);
    free(frames->entry);
}

/* Reads a part, or some of it. */
static int work_once(struct frames *frames) {
    struct frames_part *part = &frames->part[frames->next];
    int more = part->index && !frames->scan ? frames_index_read(frames, part) : -EBADMSG;

    if (more == -EBADMSG) /* no index, or a damaged one */
        more = frames_scan(frames, part);
    if (more < 0)
        return more;
    if (!more)
        frames->next++;
    frames->complete = frames->next == frames->parts;
    return 0;
}

int frames_work(struct frames *frames) {
    int64_t end = ddx_time_now() + SLICE;
    int error = 0;

    while (!error && !frames->complete && ddx_time_now() < end)
        error = work_once(frames);
    return error;
}
