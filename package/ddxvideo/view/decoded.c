/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decoded.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

#include "mp4_read.h"
#include "video_layout.h"

#define KEPT_MAX 4096 /* shots */

__attribute__((format(printf, 2, 3))) static bool fail(char *wrong, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(wrong, Y4M_ERROR_MAX, format, arguments);
    va_end(arguments);
    return false;
}

/* ---- Open ---- */

/* The first frame, which has the geometry. */
static bool look(struct decoded *decoded, struct mp4_file *file, char *wrong) {
    struct mp4_fragment fragment;
    struct stamp stamp;

    if (mp4_next_frame(file, &fragment) != MP4_FRAME)
        return fail(wrong, "holds no frame; record or copy it again");
    uint8_t *room = h264_decoder_room(&decoded->decoder, fragment.bytes);
    if (!room)
        return fail(wrong, "out of memory");
    int error = mp4_read_bytes(file, &fragment, room);
    if (error)
        return fail(wrong, "cannot be read: %s", strerror(-error));
    if (!h264_decoder_look(&decoded->decoder, &file->format, &stamp))
        return fail(wrong, "its first frame does not tell the layout of the pictures; the file is damaged");
    decoded->geometry = decoded->decoder.geometry;
    return true;
}

bool decoded_open(struct decoded *decoded, int fd, struct shot_pool *pool, uint64_t limit, char *wrong) {
    struct mp4_file file;

    *decoded = (struct decoded){.fd = fd, .pool = pool, .last = -1, .damaged = -1, .behind = -1};
    int error = mp4_open(&file, fd);
    if (error)
        return fail(wrong, "%s", error == -EBADMSG ? MP4_FOREIGN : strerror(-error));
    decoded->format = file.format;
    error = h264_decoder_open(&decoded->decoder, &file.format, 1);
    if (error)
        return fail(wrong, "%s", h264_decoder_error(error));
    if (!look(decoded, &file, wrong))
        return false;
    decoded->picture = video_layout_bytes(&decoded->geometry);
    uint64_t shots = limit / decoded->picture;
    decoded->capacity = shots > KEPT_MAX ? KEPT_MAX : shots ? (int64_t)shots : 1;
    decoded->kept = calloc((size_t)decoded->capacity, sizeof *decoded->kept);
    return decoded->kept || fail(wrong, "out of memory");
}

static void drop(struct decoded *decoded, int64_t from, int64_t end) {
    for (; from < end; from++)
        shot_drop(decoded->kept[from % decoded->capacity]);
}

static void drop_early(struct decoded *decoded) {
    drop(decoded, decoded->early_first, decoded->early_end);
    decoded->early_first = decoded->early_end = 0;
}

/* Keep none, and decode this position next. */
static void restart(struct decoded *decoded, int64_t position) {
    drop_early(decoded);
    drop(decoded, decoded->first, decoded->next);
    decoded->first = decoded->next = decoded->at = position;
    decoded->behind = -1;
}

void decoded_close(struct decoded *decoded) {
    restart(decoded, 0);
    free(decoded->kept);
    h264_decoder_close(&decoded->decoder);
    h264_decoder_close(&decoded->early);
    h264_decoder_close(&decoded->leap);
}

/* ---- One frame ---- */

/* Read a frame for a decoder. */
static bool read_frame(const struct decoded *decoded, struct h264_decoder *decoder, const struct frames_entry *entry,
                       char *wrong) {
    uint8_t begin[MP4_FRAGMENT];
    struct mp4_fragment fragment;
    uint8_t *room = entry->bytes > MP4_FRAGMENT ? h264_decoder_room(decoder, entry->bytes - MP4_FRAGMENT)
                                                : NULL; /* an index may have any number */

    if (!room)
        return fail(wrong, "frame %d: damaged", entry->number);
    const struct iovec parts[2] = {{begin, sizeof begin}, {room, entry->bytes - MP4_FRAGMENT}};
    ssize_t got = preadv(decoded->fd, parts, 2, (off_t)entry->offset);
    if (got < 0)
        return fail(wrong, "frame %d: %s", entry->number, strerror(errno));
    return (got == (ssize_t)entry->bytes && mp4_read_fragment(begin, &fragment) &&
            fragment.bytes == entry->bytes - MP4_FRAGMENT && fragment.key == entry->key) ||
           fail(wrong, "frame %d: damaged", entry->number);
}

/* Copy a decoder's picture. */
static void fill(const struct decoded *decoded, const struct h264_decoder *decoder, struct shot *shot) {
    unsigned char *planes[3];

    shot->picture.geometry = decoded->geometry;
    video_layout_place(&shot->picture, shot->memory);
    for (int i = 0; i < 3; i++)
        planes[i] = shot->memory + (shot->picture.plane[i] ? shot->picture.plane[i] - shot->picture.plane[0] : 0);
    h264_decoder_copy(decoder, planes);
}

/* The next picture of a decoder. NULL: `damaged` is set, or there is a text. */
static struct shot *decode(struct decoded *decoded, struct h264_decoder *decoder, const struct frames *frames,
                           int64_t position, char *wrong) {
    const struct frames_entry *entry = &frames->entry[position];
    struct stamp stamp;
    struct shot *shot = shot_new(decoded->pool, decoded->picture);

    if (!shot || !read_frame(decoded, decoder, entry, wrong)) { /* before decoding: a frame is decoded once */
        if (!shot)
            fail(wrong, "out of memory");
        shot_drop(shot);
        return NULL;
    }
    if (!h264_decode(decoder, entry->key, &stamp)) {
        shot_drop(shot);
        decoded->damaged = position;
        return NULL;
    }
    fill(decoded, decoder, shot);
    return shot;
}

/* The key frame with which decoding of a position begins. */
static int64_t key_before(const struct frames *frames, int64_t position) {
    const struct frames_entry *entry = frames->entry;

    while (position && !entry[position].key && entry[position - 1].part == entry[position].part)
        position--;
    return position;
}

static bool refers_to_damaged(const struct decoded *decoded, int64_t key, int64_t position) {
    return decoded->damaged >= key && decoded->damaged <= position;
}

/* ---- Jumps ---- */

#define LEAP 4 /* frames beside the wanted one: fewer are decoded as soon by one thread */
#define THREADS_MAX 4

static bool open_leap(struct decoded *decoded) {
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    int threads = processors < THREADS_MAX ? (int)processors : THREADS_MAX;

    if (!decoded->has_leap && threads > 1) {
        decoded->has_leap = !h264_decoder_open(&decoded->leap, &decoded->format, threads);
        decoded->leap.geometry = decoded->geometry;
    }
    return decoded->has_leap;
}

static bool keep(void *argument) {
    struct decoded *decoded = argument;
    struct shot *shot = shot_new(decoded->pool, decoded->picture);

    if (!shot)
        return false;
    fill(decoded, &decoded->leap, shot);
    decoded->kept[decoded->next++ % decoded->capacity] = shot;
    return true;
}

/*
 * Decode up to a position in several threads. False: there are too few frames, or one is damaged, which `decoder` finds
 * out exactly.
 */
static bool leap(struct decoded *decoded, const struct frames *frames, int64_t key, int64_t position) {
    char wrong[Y4M_ERROR_MAX];
    bool good = position - key >= LEAP && position - key < decoded->capacity && open_leap(decoded);

    if (!good)
        return false;
    restart(decoded, key);
    h264_decoder_rewind(&decoded->leap);
    for (int64_t at = key; good && at <= position; at++)
        good = read_frame(decoded, &decoded->leap, &frames->entry[at], wrong) &&
               h264_decode_many(&decoded->leap, at == position, keep, decoded);
    decoded->at = -1;
    decoded->behind = key;
    return good && decoded->next == position + 1;
}

/* After a jump: `decoder` decodes one of the frames as well, so that it can go on with the next one. */
static void follow(struct decoded *decoded, const struct frames *frames) {
    const struct frames_entry *entry = &frames->entry[decoded->behind];
    char wrong[Y4M_ERROR_MAX];
    struct stamp stamp;

    if (!read_frame(decoded, &decoded->decoder, entry, wrong) || !h264_decode(&decoded->decoder, entry->key, &stamp)) {
        decoded->behind = -1; /* the next frame is decoded from its key frame on, which reports why */
    } else if (++decoded->behind >= decoded->next) {
        decoded->at = decoded->behind;
        decoded->behind = -1;
    }
}

/* ---- Ahead of steps back ---- */

bool decoded_can_prepare(const struct decoded *decoded, const struct frames *frames) {
    int64_t first = decoded->first;

    if (decoded->early_first < decoded->early_end || decoded->behind >= 0)
        return true;
    if (!decoded->back || first == decoded->next || !first ||
        frames->entry[first - 1].part != frames->entry[first].part)
        return false;
    int64_t key = key_before(frames, first - 1);
    return key_before(frames, decoded->last) <= first && decoded->last - key < decoded->capacity &&
           !refers_to_damaged(decoded, key, first - 1);
}

static bool open_early(struct decoded *decoded) {
    if (!decoded->has_early) {
        decoded->has_early = !h264_decoder_open(&decoded->early, &decoded->format, 1);
        decoded->early.geometry = decoded->geometry;
    }
    return decoded->has_early;
}

void decoded_prepare(struct decoded *decoded, const struct frames *frames) {
    char wrong[Y4M_ERROR_MAX];

    if (!decoded_can_prepare(decoded, frames))
        return;
    if (decoded->behind >= 0) {
        follow(decoded, frames);
        return;
    }
    if (decoded->early_first == decoded->early_end) {
        decoded->early_first = decoded->early_end = key_before(frames, decoded->first - 1);
        if (decoded->next - decoded->early_first > decoded->capacity) { /* instead of the frames that come last */
            drop(decoded, decoded->early_first + decoded->capacity, decoded->next);
            decoded->next = decoded->early_first + decoded->capacity;
        }
    }
    struct shot *shot =
        open_early(decoded) ? decode(decoded, &decoded->early, frames, decoded->early_end, wrong) : NULL;
    if (!shot) {
        drop_early(decoded);
        decoded->back = false; /* a step that needs the frame reports why */
        return;
    }
    decoded->kept[decoded->early_end++ % decoded->capacity] = shot;
    if (decoded->early_end < decoded->first)
        return;
    decoded->first = decoded->early_first;
    decoded->early_first = decoded->early_end = 0;
}

/* ---- Any frame ---- */

static bool is_kept(const struct decoded *decoded, int64_t position) {
    return position >= decoded->first && position < decoded->next;
}

/* Decode up to a position, which is not kept. */
static void decode_up_to(struct decoded *decoded, const struct frames *frames, int64_t key, int64_t position,
                         char *wrong) {
    bool follows = position >= decoded->next && decoded->next > key;

    while (follows && decoded->behind >= 0)
        follow(decoded, frames);
    bool goes_on = follows && decoded->at == decoded->next;
    decoded->back = !goes_on;
    if (!goes_on && leap(decoded, frames, key, position))
        return;
    if (!goes_on)
        restart(decoded, key);
    while (decoded->next <= position) {
        if (decoded->next - decoded->first == decoded->capacity) {
            drop_early(decoded);
            shot_drop(decoded->kept[decoded->first++ % decoded->capacity]);
        }
        struct shot *shot = decode(decoded, &decoded->decoder, frames, decoded->next, wrong);
        if (!shot)
            return;
        decoded->kept[decoded->next++ % decoded->capacity] = shot;
        decoded->at = decoded->next;
    }
}

struct shot *decoded_take(struct decoded *decoded, const struct frames *frames, int64_t position, char *wrong) {
    const struct frames_entry *entry = frames->entry;
    int64_t key = key_before(frames, position);

    while (decoded->early_first < decoded->early_end && position >= decoded->early_first && position < decoded->first)
        decoded_prepare(decoded, frames);
    if (is_kept(decoded, position))
        decoded->back = position < decoded->last || (decoded->back && position == decoded->last);
    else if (!refers_to_damaged(decoded, key, position))
        decode_up_to(decoded, frames, key, position, wrong);
    decoded->last = position;
    if (is_kept(decoded, position))
        return shot_ref(decoded->kept[position % decoded->capacity]);
    if (refers_to_damaged(decoded, key, position) && decoded->damaged < position)
        fail(wrong, "frame %d cannot be decoded: frame %d, to which it refers, is damaged", entry[position].number,
             entry[decoded->damaged].number);
    else if (refers_to_damaged(decoded, key, position))
        fail(wrong, "frame %d cannot be decoded", entry[position].number);
    return NULL;
}
