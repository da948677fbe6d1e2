/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A source gives pictures: a video item, a stream, a file. Each kind has its own struct, which begins with a struct
 * source. Pictures have positions that rise by one. All functions are for the main thread, and none of them waits,
 * except for a read of the disk.
 */
#ifndef DDXVIDEO_SOURCE_H
#define DDXVIDEO_SOURCE_H

#include "history.h"

struct surface;

struct source_state {
    bool failed;    /* no picture ever came, and none will come: a line has been printed */
    bool working;   /* work() can find more positions */
    bool preparing; /* work() can decode frames that may be shown next */
    uint64_t lost;  /* frames */
    double rate;    /* frames a second; 0: not known */
    char text[120]; /* what the source waits for; "": nothing */
};

struct source {
    bool live; /* pictures come without a request */
    char name[64];
    void (*range)(struct source *source, int64_t *oldest, int64_t *newest);
    struct shot *(*take)(struct source *source, int64_t position);
    int64_t (*time)(struct source *source, int64_t position);
    void (*work)(struct source *source);
    void (*state)(struct source *source, struct source_state *state);
    void (*close)(struct source *source);
};

/* Needed by live sources. */
struct source_limits {
    unsigned frames;
    uint64_t bytes;
};

/*
 * Open the video item `name` of the store at this port, which need not exist yet. Each picture wakes `surface`. NULL:
 * no memory.
 */
struct source *source_item(const char *name, int port, const struct source_limits *limits, struct surface *surface);

/* Settings for source_stream(): options of decode. */
struct source_stream {
    long port;
    const char *group, *interface, *key;
    const char *instance;
    int store; /* port */
};

/* NULL, after a line: a setting is wrong. With `check`, settings are only checked, and the result is NULL as well. */
struct source *source_stream(const struct source_stream *settings, bool check, const struct source_limits *limits,
                             struct surface *surface, int *status);

/*
 * Open a Y4M or MP4 file, or all files of its recording. Decoded pictures of up to `limit` bytes are kept. NULL, after
 * a line: *status is the exit status.
 */
struct source *source_file(const char *path, uint64_t limit, int *status);

#endif
