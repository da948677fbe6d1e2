/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Positions of all frames in a file, or in all files of a recording. They are found in steps, so that the first picture
 * of a large file can be shown at once. For a file of a recording the whole index is read, for other files their FRAME
 * lines, or the fragments of an MP4 file.
 */
#ifndef DDXVIDEO_FRAMES_H
#define DDXVIDEO_FRAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "y4m.h"

/* The frames that are known so far, of a file or of all files of a recording. */
struct frames_entry {
    uint64_t offset; /* of its FRAME line or fragment */
    int64_t time;    /* ns: of the capture if known, otherwise since the first frame */
    uint32_t bytes;  /* line and picture, or the whole fragment */
    uint32_t part;
    uint32_t missing; /* frames before it */
    int32_t number;   /* the source's, or from 0 */
    bool key;         /* of an MP4 file: a key frame */
};

struct frames_part {
    char *path;
    char *index;         /* path of its index, or NULL */
    bool follows;        /* follows the part before it without a gap */
    int64_t wall_offset; /* of the frames' times; 0: not known */
};

struct frames {
    struct frames_entry *entry;
    int64_t count;
    struct frames_part *part;
    unsigned parts;
    char name[64];  /* of the item that was recorded, or of the file */
    char text[120]; /* the first error, "" if there is none */
    uint64_t lost;
    bool complete;
    /* private: */
    int64_t room;
    unsigned next;           /* the part to read */
    uint32_t cut;            /* frames that the previous part has lost at its end */
    uint64_t sequence, step; /* of the last frame in the store */
    struct frames_scan *scan;
};

/* Read the header of an open Y4M file. Its length, or 0 and a text in error[Y4M_ERROR_MAX]. */
size_t frames_header(int fd, struct y4m_header *header, char *error);

/* Find the files. 0 or -errno. Call frames_close() in each case. */
int frames_open(struct frames *frames, const char *path);
void frames_close(struct frames *frames);

/* Find more positions, for a few ms. -ENOMEM, or 0. */
int frames_work(struct frames *frames);

#endif
