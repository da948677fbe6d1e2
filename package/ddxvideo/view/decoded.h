/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The pictures of an MP4 file. A picture is decoded from the key frame before it on, after a jump by several threads.
 * The last decoded pictures are kept, and the second before them is decoded ahead of steps back, so that these need
 * not wait for the decoder.
 */
#ifndef DDXVIDEO_DECODED_H
#define DDXVIDEO_DECODED_H

#include "frames.h"
#include "h264_decode.h"
#include "history.h"

struct decoded {
    struct ddxvideo_geometry geometry; /* of the pictures */
    /* private: */
    int fd;
    struct mp4_format format;
    struct shot_pool *pool;
    size_t picture;      /* bytes */
    int64_t capacity;    /* shots */
    struct shot **kept;  /* the shot of a position is at position % capacity */
    int64_t first, next; /* positions of kept shots */
    struct h264_decoder decoder;
    int64_t at;               /* the position that `decoder` can decode next */
    struct h264_decoder leap; /* for jumps: with several threads; opened when it is needed first */
    bool has_leap;            /* or it cannot be opened */
    int64_t behind;           /* after a jump: the position that `decoder` must decode next to reach `next`; -1: none */
    int64_t last;             /* the position that was taken last */
    bool back;                /* steps back are likely: the last one was one, or a jump */
    struct h264_decoder early;      /* for the frames before `first`; opened when it is needed first */
    bool has_early;                 /* or it cannot be opened */
    int64_t early_first, early_end; /* these were decoded so far; they are kept as well. Equal: none */
    int64_t damaged;                /* position of a frame that cannot be decoded; -1: none is known */
};

/*
 * Keep pictures of up to `limit` bytes, one at least. The file stays the caller's. False, with a text in wrong[
 * Y4M_ERROR_MAX]. Call decoded_close() in any case.
 */
bool decoded_open(struct decoded *decoded, int fd, struct shot_pool *pool, uint64_t limit, char *wrong);
void decoded_close(struct decoded *decoded);

/* The picture of a frame of this file, without number and times. NULL, with a text in `wrong`. */
struct shot *decoded_take(struct decoded *decoded, const struct frames *frames, int64_t position, char *wrong);

/* Whether frames should be decoded ahead; decoded_prepare() decodes one of them. */
bool decoded_can_prepare(const struct decoded *decoded, const struct frames *frames);
void decoded_prepare(struct decoded *decoded, const struct frames *frames);

#endif
