/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The MP4 files of compressed recordings. Block 0 is `ftyp`, 16 bytes `free`, `moov` with `mvex`, `free`; a fragment
 * (`moof`, `mdat`) for each frame follows: so far every player opens the file, however it ends. A finished file also
 * has a table (`moov` with the place of each frame), and its 16 bytes are the header of an `mdat` up to that table:
 * then it is a plain MP4 file, in which every player seeks. One form: the bytes follow from the format and the frames.
 *
 * The time scale is 1 us; a file begins at time 0.
 */
#ifndef DDXVIDEO_MP4_WRITE_H
#define DDXVIDEO_MP4_WRITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MP4_BLOCK 4096   /* bytes of block 0 */
#define MP4_FRAGMENT 108 /* bytes of a fragment before the frame's own */
#define MP4_COVER_AT 32  /* offset of the 16 bytes */
#define MP4_COVER 16
#define MP4_SET_MAX 128                   /* bytes of a parameter set */
#define MP4_STEP_MAX UINT32_C(1800000000) /* us from frame to frame: 30 minutes */
#define MP4_KEY UINT32_C(0x80000000)

/* Properties of all frames. */
struct mp4_format {
    int width, height;
    int aspect_num, aspect_den;                 /* of a pixel; 0/0 if unknown */
    uint32_t duration;                          /* us of a frame by its nominal rate */
    int chroma;                                 /* 1: 4:2:0, 2: 4:2:2, 3: 4:4:4 */
    uint8_t sps[MP4_SET_MAX], pps[MP4_SET_MAX]; /* H.264's parameter sets */
    size_t sps_size, pps_size;
};

/* Whether pictures of this H.264 profile are always 8-bit 4:2:0: baseline, main, extended. */
static inline bool mp4_is_simple(int profile) {
    return profile == 66 || profile == 77 || profile == 88;
}

/* A frame in the table. */
struct mp4_entry {
    uint32_t bytes; /* without MP4_FRAGMENT */
    uint32_t step;  /* us since the frame before, 0 of the first one; and MP4_KEY for a key frame */
};

/* Write block 0. False if a parameter set is too short, or larger than MP4_SET_MAX. */
bool mp4_write_head(uint8_t block[MP4_BLOCK], const struct mp4_format *format);

/* A fragment up to the frame's bytes. */
struct mp4_fragment {
    uint32_t number; /* from 1 */
    uint64_t time;   /* us */
    uint32_t duration;
    uint32_t bytes;
    bool key;
};

void mp4_write_fragment(uint8_t to[MP4_FRAGMENT], const struct mp4_fragment *fragment);

/* The table, which the caller frees. NULL: no memory, or more frames than a table can hold. */
uint8_t *mp4_table(const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count, size_t *size);

/* Bytes that the table of that many frames has at most. */
static inline size_t mp4_table_room(uint32_t count) {
    return MP4_BLOCK + (size_t)count * (8 + 4 + 4 + 8); /* duration, number of a key frame, size, place */
}

/* Where these frames end, and the table begins. */
uint64_t mp4_end(const struct mp4_entry *entries, uint32_t count);

/* The final content of the 16 bytes; `end`: where the table begins. */
void mp4_write_cover(uint8_t to[MP4_COVER], uint64_t end);

/*
 * Finish a file that consists of block 0 and these frames: write and flush the table, then the 16 bytes. In this order,
 * because a file with them and without a table cannot be played. -errno: then it is as it was, or has a table that
 * players overlook. Otherwise the bytes of the whole file.
 */
int64_t mp4_finish(int fd, const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count);

/*
 * When players show the frames of an MP4 file: from their capture times alone, so that recorder, recovery and
 * verification get the same times. Zeros at the begin of a file.
 */
struct mp4_times {
    bool begun;
    int64_t base;   /* capture time that is shown as 0 */
    int64_t last;   /* capture time of the last frame */
    uint64_t shown; /* us at which it is shown */
};

/* ns from `from` to `to`; INT64_MAX or INT64_MIN beyond that. */
int64_t mp4_between(int64_t from, int64_t to);

/* Whether a frame captured at `time` (ns) comes more than 30 minutes after the last one: a file cannot express that. */
bool mp4_times_is_gap(const struct mp4_times *times, int64_t time);

/*
 * The next frame: us since the one before, 0 for the first one. A time that does not rise counts as 1 us later, a gap
 * above 30 minutes as 30 minutes; the following times are moved by as much.
 */
uint32_t mp4_times_next(struct mp4_times *times, int64_t time);

#endif
