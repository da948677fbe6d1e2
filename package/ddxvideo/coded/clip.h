/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A recording to be played: a Y4M file or pipe (y4m.h), or an MP4 file of ours (mp4_read.h). */
#ifndef DDXVIDEO_CLIP_H
#define DDXVIDEO_CLIP_H

#include <stdint.h>

#include "ddxvideo.h"
#include "y4m.h"

#define CLIP_ERROR_MAX Y4M_ERROR_MAX

enum clip_result {
    CLIP_OK,
    CLIP_END,     /* no more frames */
    CLIP_BAD,     /* bad input */
    CLIP_ERROR,   /* a system error: memory, disk */
    CLIP_DAMAGED, /* of an MP4 file: this frame cannot be decoded, or refers to one that cannot; more may follow */
};

struct clip {
    struct ddxvideo_geometry geometry; /* of the pictures it gives */
    int64_t frames;                    /* whole frames read in this pass */
    int64_t start;                     /* CLOCK_MONOTONIC of the first frame when it was recorded; -1: not known */
    bool cut;                          /* the last failure: the file ends within a frame */
    char error[CLIP_ERROR_MAX];        /* of the last failure */
    /* private: */
    struct y4m_reader y4m;
    struct clip_mp4 *mp4; /* NULL: Y4M */
};

/*
 * Open a file; `format` is the wanted layout, as for y4m_parse_header(). `-` is standard input, Y4M. Call clip_close()
 * in any case.
 */
enum clip_result clip_open(struct clip *clip, const char *path, int format);
void clip_close(struct clip *clip);

/*
 * Read the next frame into planes without padding, of clip->geometry; *time is ns since the first frame, or -1 if it is
 * not known. On any other result than CLIP_OK the planes are undefined.
 */
enum clip_result clip_read(struct clip *clip, unsigned char *const plane[3], int64_t *time);

/* Back to the first frame. CLIP_BAD for input that cannot be rewound (a pipe). */
enum clip_result clip_rewind(struct clip *clip);

#endif
