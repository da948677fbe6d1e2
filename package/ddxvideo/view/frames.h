/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Where each frame of a file, or of all files of a recording, lies. It becomes known bit by bit, so that the first
 * picture of a large file is there at once: the index of a recording's file is read as a whole, of other files the
 * FRAME lines are.
 */
#ifndef DDXVIDEO_FRAMES_H
#define DDXVIDEO_FRAMES_H

#include "y4m.h"

struct frames_entry {
    uint64_t offset; /* of its FRAME line */
    int64_t time;    /* ns: of the capture if that is known, else since the first frame */
    uint32_t bytes;  /* line and picture */
    uint32_t part;
    uint32_t missing; /* frames before it */
    int32_t number;   /* the source's, or from 0 */
};

struct frames_part {
    char *path;
    char *index;         /* path of its index, or NULL */
    bool follows;        /* directly on the part before it */
    int64_t wall_offset; /* of the times of its frames; 0: they are not known */
};

struct frames {
    struct frames_entry *entry;
    int64_t count;
    struct frames_part *part;
    unsigned parts;
    char name[64];  /* of the item that was recorded, or of the file */
    char text[120]; /* what is wrong, "" if nothing is */
    uint64_t lost;
    bool complete;
    /* private: */
    int64_t room;
    unsigned next;   /* part to be read */
    uint32_t cut;    /* frames that the part before has lost at its end */
    uint64_t sequence, step; /* of the last frame in the store */
    struct frames_scan *scan;
};

/* Find out which files there are. 0 or -errno. frames_close() in any case. */
int frames_open(struct frames *frames, const char *path);
void frames_close(struct frames *frames);

/* Learn more of them, for a few ms. -ENOMEM, or 0. */
int frames_work(struct frames *frames);

/* The header of a Y4M file that is open: its length, or 0 and a text in error[Y4M_ERROR_MAX]. */
size_t frames_header(int fd, struct y4m_header *header, char *error);

#endif
