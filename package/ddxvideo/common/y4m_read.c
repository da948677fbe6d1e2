/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Reads Y4M files. One readv() per frame fills the planes in place and, after them, `ahead`, which then holds the next
 * FRAME line.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include "picture_convert.h"
#include "video_layout.h"
#include "y4m.h"

#define AHEAD_WANTED 64 /* enough for a FRAME line and little enough to copy */
#define LOOK_MS 100     /* between checks for a stop while waiting for a pipe */

static bool (*is_stopping)(void);

void y4m_stop_when(bool (*stopping)(void)) {
    is_stopping = stopping;
}

/*
 * As readv(), but returns 0 on a request to stop. A signal alone does not end a wait in readv() if it comes right
 * before.
 */
static ssize_t read_now(struct y4m_reader *reader, const struct iovec *parts, int count) {
    for (;;) {
        struct pollfd wait = {.fd = reader->fd, .events = POLLIN};
        int ready = reader->waits ? poll(&wait, 1, LOOK_MS) : 1;

        if (ready <= 0 && is_stopping && is_stopping())
            return 0;
        if (ready <= 0)
            continue;
        ssize_t got = readv(reader->fd, parts, count);
        if (got >= 0 || (errno != EINTR && errno != EAGAIN))
            return got;
    }
}

__attribute__((format(printf, 3, 4))) static enum y4m_result fail(struct y4m_reader *reader, enum y4m_result result,
                                                                  const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(reader->error, sizeof reader->error, format, arguments);
    va_end(arguments);
    return result;
}

static enum y4m_result fail_errno(struct y4m_reader *reader) {
    return fail(reader, errno == EISDIR ? Y4M_BAD : Y4M_ERROR, "cannot be read: %s", strerror(errno));
}

/* A line into line[size], without its line feed. Y4M_END: the file ends before its first byte. */
static enum y4m_result read_line(struct y4m_reader *reader, char *line, size_t size, const char *what) {
    size_t length = 0;

    *line = 0;
    for (;;) {
        while (reader->ahead_begin < reader->ahead_end) {
            char c = reader->ahead[reader->ahead_begin++];

            line[length] = 0;
            if (c == '\n')
                return Y4M_OK;
            if (!c || length + 1 == size)
                return fail(reader, Y4M_BAD, "bad %s: %s; the file is damaged, or no Y4M%s", what,
                            c ? "the line is too long" : "it holds a zero byte",
                            reader->frames ? "" : "; make one: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m");
            line[length++] = c;
        }
        const struct iovec part = {reader->ahead, AHEAD_WANTED};
        ssize_t got = reader->at_end ? 0 : read_now(reader, &part, 1);
        if (got < 0)
            return fail_errno(reader);
        if (!got) {
            reader->at_end = true;
            line[length] = 0;
            reader->cut = length > 0;
            return length ? fail(reader, Y4M_BAD, "bad %s: the file ends in it; it was cut short", what) : Y4M_END;
        }
        reader->ahead_begin = 0;
        reader->ahead_end = (size_t)got;
    }
}

/* Fill the given memory, first from `ahead`, then from the file. */
static enum y4m_result read_parts(struct y4m_reader *reader, struct iovec *parts, int count) {
    struct iovec all[5];
    int used = 0;

    for (int i = 0; i < count; i++) {
        size_t ready = reader->ahead_end - reader->ahead_begin;
        size_t take = ready < parts[i].iov_len ? ready : parts[i].iov_len;

        memcpy(parts[i].iov_base, reader->ahead + reader->ahead_begin, take);
        reader->ahead_begin += take;
        if (take < parts[i].iov_len)
            all[used++] = (struct iovec){(char *)parts[i].iov_base + take, parts[i].iov_len - take};
    }
    if (!used)
        return Y4M_OK; /* tiny frames: all were in `ahead` */
    all[used] = (struct iovec){reader->ahead, AHEAD_WANTED};
    reader->ahead_begin = reader->ahead_end = 0;

    for (int next = 0; next < used;) {
        ssize_t got = read_now(reader, all + next, used - next + 1);

        if (got < 0)
            return fail_errno(reader);
        if (!got) {
            reader->at_end = reader->cut = true;
            return fail(reader, Y4M_BAD, "cut short in frame %lld (from 0); the frames before it are whole",
                        (long long)reader->frames);
        }
        size_t rest = (size_t)got;
        for (; next < used && rest >= all[next].iov_len; next++)
            rest -= all[next].iov_len;
        if (next == used) {
            reader->ahead_end = rest;
        } else {
            all[next].iov_base = (char *)all[next].iov_base + rest;
            all[next].iov_len -= rest;
        }
    }
    return Y4M_OK;
}

static enum y4m_result read_header(struct y4m_reader *reader, int format) {
    char line[Y4M_HEADER_MAX];
    enum y4m_result result = read_line(reader, line, sizeof line, "header");

    if (result == Y4M_END)
        return fail(reader, Y4M_BAD, "is empty; record or copy it again");
    bool foreign = result == Y4M_BAD && *line && strncmp(line, Y4M_MAGIC, strlen(Y4M_MAGIC));
    if (result != Y4M_OK && !foreign) /* otherwise the parser reports that this is no Y4M at all */
        return result;
    return y4m_parse_header(line, format, &reader->header, reader->error) ? Y4M_OK : Y4M_BAD;
}

struct picture_converter *y4m_converter(const struct y4m_header *header) {
    const struct y4m_layout *layout = header->layout;
    const struct picture_kind kind = {.bits = layout->bits,
                                      .chroma_x = layout->chroma_x,
                                      .chroma_y = layout->chroma_y,
                                      .full = header->range == DDX_VIDEO_RANGE_FULL,
                                      .centred = layout->format == DDX_VIDEO_420_JPEG};

    return picture_converter_new(&kind, &header->geometry);
}

bool y4m_convert(const struct y4m_header *header, struct picture_converter *converter, const unsigned char *from,
                 unsigned char *const plane[3]) {
    const struct y4m_layout *layout = header->layout;
    int sample = layout->bits > 8 ? 2 : 1, width = header->geometry.width, stride[3], to_stride[3], rows;
    const unsigned char *planes[3];
    size_t offset = 0;

    for (int i = 0; i < 3; i++) {
        int columns = i && layout->chroma_x > 0 ? (width + (1 << layout->chroma_x) - 1) >> layout->chroma_x : width;

        stride[i] = columns * sample;
        planes[i] = from + offset;
        offset += y4m_plane_bytes(header, i);
        video_layout_plane(video_layout_of(header->geometry.format), width, header->geometry.height, i, &to_stride[i],
                           &rows);
    }
    return picture_convert(converter, planes, stride, plane, to_stride);
}

enum y4m_result y4m_open(struct y4m_reader *reader, const char *path, int format) {
    memset(reader, 0, sizeof *reader);
    struct stat status;
    /* Does not wait for the other end of a pipe. */
    reader->fd = strcmp(path, "-") ? open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK) : fcntl(0, F_DUPFD_CLOEXEC, 3);
    if (reader->fd < 0)
        return fail(reader, Y4M_BAD, "cannot be opened: %s", strerror(errno));
    reader->waits = !fstat(reader->fd, &status) && !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode);
    enum y4m_result result = read_header(reader, format);
    if (result != Y4M_OK || y4m_is_plain(&reader->header))
        return result;
    size_t bytes = 0;
    for (int i = 0; i < 4; i++)
        bytes += y4m_plane_bytes(&reader->header, i);
    reader->scratch = malloc(bytes + PICTURE_READ_BEYOND);
    reader->converter = y4m_converter(&reader->header);
    if (!reader->scratch || !reader->converter)
        return fail(reader, Y4M_ERROR, "C%s cannot be converted to %s: out of memory", reader->header.layout->tag,
                    ddxvideo_layout_name(reader->header.geometry.format));
    return Y4M_OK;
}

void y4m_close(struct y4m_reader *reader) {
    if (reader->fd >= 0)
        close(reader->fd);
    picture_converter_free(reader->converter);
    free(reader->scratch);
    memset(reader, 0, sizeof *reader);
    reader->fd = -1;
}

enum y4m_result y4m_read(struct y4m_reader *reader, unsigned char *const plane[3], int64_t *time) {
    char line[Y4M_FRAME_LINE_MAX];
    char error[Y4M_ERROR_MAX];
    struct iovec parts[4];
    int count = 0;
    enum y4m_result result = read_line(reader, line, sizeof line, "FRAME line");

    if (result != Y4M_OK)
        return result;
    if (!y4m_parse_frame(line, time, error))
        return fail(reader, Y4M_BAD, "frame %lld: %.150s", (long long)reader->frames, error);
    if (!reader->frames)
        reader->start = y4m_parse_start(line);

    unsigned char *to = reader->scratch;
    for (int i = 0; i < 4; i++) {
        size_t bytes = y4m_plane_bytes(&reader->header, i);

        if (!bytes)
            continue;
        parts[count++] = (struct iovec){to ? to : plane[i], bytes};
        if (to)
            to += bytes;
    }
    result = read_parts(reader, parts, count);
    if (result != Y4M_OK)
        return result;
    if (reader->converter && !y4m_convert(&reader->header, reader->converter, reader->scratch, plane))
        return fail(reader, Y4M_ERROR, "frame %lld cannot be converted to %s", (long long)reader->frames,
                    ddxvideo_layout_name(reader->header.geometry.format));
    reader->frames++;
    return Y4M_OK;
}

enum y4m_result y4m_rewind(struct y4m_reader *reader) {
    if (lseek(reader->fd, 0, SEEK_SET))
        return fail(reader, Y4M_BAD, "cannot be played again: it is no regular file; leave out -loop");
    reader->at_end = reader->cut = false;
    reader->ahead_begin = reader->ahead_end = 0;
    reader->frames = 0;
    struct y4m_header before = reader->header;
    enum y4m_result result = read_header(reader, before.geometry.format);
    if (result == Y4M_OK &&
        (!ddxvideo_same_layout(&before.geometry, &reader->header.geometry) || before.layout != reader->header.layout))
        return fail(reader, Y4M_BAD, "changed while it was played");
    return result;
}
