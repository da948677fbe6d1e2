/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The input is not trusted: what is taken from it is written again, and must give the same bytes. */
#include "mp4_read.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bits.h"

/* Places in block 0; all boxes before the parameter sets have one size. */
#define ENTRY_AT 473 /* of the sample entry, `avc1` */
#define WIDTH_AT (ENTRY_AT + 32)
#define RECORD_AT (ENTRY_AT + 86) /* of `avcC` */
#define SETS_AT (RECORD_AT + 14)  /* of the SPS's size */
#define DURATION_BEFORE 12        /* of the frames, before the end of `moov` */

/* Places in a fragment. */
#define NUMBER_AT 20
#define TIME_AT 60
#define SIZES_AT 88 /* duration, bytes, flags */
#define KEY 0x02000000

/* A parameter set and its size; the next byte, or NULL. */
static const uint8_t *take_set(const uint8_t *from, uint8_t *to, size_t *size) {
    *size = get16(from);
    if (!*size || *size > MP4_SET_MAX)
        return NULL;
    memcpy(to, from + 2, *size);
    return from + 2 + *size;
}

bool mp4_read_head(const uint8_t block[MP4_BLOCK], struct mp4_format *format, uint64_t *end) {
    uint8_t same[MP4_BLOCK];
    uint32_t film = get32(block + MP4_COVER_AT + MP4_COVER);

    memset(format, 0, sizeof *format);
    format->width = get16(block + WIDTH_AT);
    format->height = get16(block + WIDTH_AT + 2);
    const uint8_t *at = take_set(block + SETS_AT, format->sps, &format->sps_size);
    if (at)
        at = take_set(at + 1, format->pps, &format->pps_size);
    if (!at || film > MP4_BLOCK - 64 || film < SETS_AT)
        return false;
    format->chroma = 1;
    if (!mp4_is_simple(format->sps[1])) {
        format->chroma = at[0] & 3;
        at += 4;
    }
    if (!memcmp(at + 4, "pasp", 4)) {
        format->aspect_num = (int)(get32(at + 8) & INT32_MAX);
        format->aspect_den = (int)(get32(at + 12) & INT32_MAX);
    }
    format->duration = get32(block + MP4_COVER_AT + MP4_COVER + film - DURATION_BEFORE);
    if (!mp4_write_head(same, format))
        return false;
    *end = 0;
    if (get32(block + MP4_COVER_AT) == 1) { /* finished */
        *end = get64(block + MP4_COVER_AT + 8);
        if (*end > INT64_MAX - MP4_COVER_AT)
            return false;
        *end += MP4_COVER_AT;
        mp4_write_cover(same + MP4_COVER_AT, *end);
    }
    return !memcmp(block, same, sizeof same);
}

const uint8_t *mp4_decoder_record(const uint8_t block[MP4_BLOCK], size_t *size) {
    *size = get32(block + RECORD_AT) - 8;
    return block + RECORD_AT + 8;
}

bool mp4_read_fragment(const uint8_t from[MP4_FRAGMENT], struct mp4_fragment *fragment) {
    uint8_t same[MP4_FRAGMENT];

    *fragment = (struct mp4_fragment){.number = get32(from + NUMBER_AT),
                                      .time = get64(from + TIME_AT),
                                      .duration = get32(from + SIZES_AT),
                                      .bytes = get32(from + SIZES_AT + 4),
                                      .key = get32(from + SIZES_AT + 8) == KEY};
    mp4_write_fragment(same, fragment);
    return !memcmp(from, same, sizeof same);
}

/* As many bytes as there are; for fewer than `size`, errno is set: ENODATA at the file's end. */
static size_t read_at(int fd, uint8_t *to, size_t size, uint64_t at) {
    size_t got = 0;

    while (got < size) {
        ssize_t more = pread(fd, to + got, size - got, (off_t)(at + got));

        if (more < 0 && errno == EINTR)
            continue;
        if (more <= 0) {
            errno = more ? errno : ENODATA;
            break;
        }
        got += (size_t)more;
    }
    return got;
}

bool mp4_is_any(int fd) {
    uint8_t first[8];

    return read_at(fd, first, sizeof first, 0) == sizeof first && !memcmp(first + 4, "ftyp", 4);
}

int mp4_open(struct mp4_file *file, int fd) {
    uint8_t block[MP4_BLOCK];
    struct stat status;

    *file = (struct mp4_file){.fd = fd, .at = MP4_BLOCK};
    if (fstat(fd, &status))
        return -errno;
    file->size = (uint64_t)status.st_size;
    if (read_at(fd, block, sizeof block, 0) != sizeof block || !mp4_read_head(block, &file->format, &file->end))
        return -EBADMSG;
    return file->end && file->end < MP4_BLOCK ? -EBADMSG : 0;
}

/* Why there is no whole frame at the next frame's place. */
static enum mp4_next no_frame(const struct mp4_file *file, const uint8_t *from, size_t got) {
    if (file->end)
        return file->at == file->end ? MP4_END : file->at >= file->size ? MP4_CUT : MP4_DAMAGED;
    if (!got)
        return MP4_END;
    return got < MP4_FRAGMENT || !memcmp(from + 4, "moov", 4) ? MP4_CUT : MP4_DAMAGED;
}

enum mp4_next mp4_next_frame(struct mp4_file *file, struct mp4_fragment *fragment) {
    uint8_t from[MP4_FRAGMENT];
    uint64_t limit = file->end && file->end < file->size ? file->end : file->size;

    if (file->at >= limit)
        return no_frame(file, from, 0);
    size_t got = read_at(file->fd, from, sizeof from, file->at);
    if (got < sizeof from || !mp4_read_fragment(from, fragment))
        return no_frame(file, from, got);
    bool first = !file->frames;
    if (fragment->number != file->frames + 1 || fragment->duration != file->format.duration ||
        (first ? fragment->time || !fragment->key
               : fragment->time <= file->time || fragment->time - file->time > MP4_STEP_MAX) ||
        file->frames >= UINT32_MAX / 32)
        return MP4_DAMAGED;
    if (limit - file->at < MP4_FRAGMENT || fragment->bytes > limit - file->at - MP4_FRAGMENT)
        return file->end && limit == file->end ? MP4_DAMAGED : MP4_CUT;
    file->at += MP4_FRAGMENT + (uint64_t)fragment->bytes;
    file->time = fragment->time;
    file->frames++;
    return MP4_FRAME;
}

int mp4_read_bytes(const struct mp4_file *file, const struct mp4_fragment *fragment, uint8_t *to) {
    return read_at(file->fd, to, fragment->bytes, file->at - fragment->bytes) == fragment->bytes ? 0 : -errno;
}

bool mp4_last_frame(const struct mp4_file *file, struct mp4_fragment *fragment) {
    uint8_t from[MP4_FRAGMENT];

    /* The table ends with the place of the last frame. */
    if (!file->end || file->size <= file->end || read_at(file->fd, from, 8, file->size - 8) != 8)
        return false;
    uint64_t place = get64(from);
    return place >= MP4_BLOCK + MP4_FRAGMENT && place <= file->end &&
           read_at(file->fd, from, sizeof from, place - MP4_FRAGMENT) == sizeof from &&
           mp4_read_fragment(from, fragment) && fragment->bytes == file->end - place;
}

void mp4_rewind(struct mp4_file *file) {
    file->at = MP4_BLOCK;
    file->frames = 0;
    file->time = 0;
}

int64_t mp4_entries(struct mp4_file *file, struct mp4_entry **entries, enum mp4_next *last) {
    struct mp4_fragment fragment;
    uint64_t before = 0;
    uint32_t room = 0;

    *entries = NULL;
    mp4_rewind(file);
    while ((*last = mp4_next_frame(file, &fragment)) == MP4_FRAME) {
        if (file->frames > room) {
            room = room ? room * 2 : 1024;
            struct mp4_entry *more = reallocarray(*entries, room, sizeof **entries);

            if (!more) {
                free(*entries);
                *entries = NULL;
                return -ENOMEM;
            }
            *entries = more;
        }
        (*entries)[file->frames - 1] =
            (struct mp4_entry){fragment.bytes, (uint32_t)(fragment.time - before) | (fragment.key ? MP4_KEY : 0)};
        before = fragment.time;
    }
    return file->frames;
}
