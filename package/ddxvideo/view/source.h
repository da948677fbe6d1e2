/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Where pictures come from: a video item, a stream, a file. Each kind has a struct of its own that begins with a struct
 * source. Pictures have positions that rise by one. All functions are for the main thread, and none of them waits, but
 * for a read of the disk.
 */
#ifndef DDXVIDEO_SOURCE_H
#define DDXVIDEO_SOURCE_H

#include "shot.h"

struct surface;

struct source_state {
    bool failed;    /* nothing will come any more, and nothing ever came: a line has been printed */
    bool working;   /* more positions become known by source_work() */
    uint64_t lost;  /* frames */
    double rate;    /* a second; 0: not known */
    char text[120]; /* what is missing; "" if nothing is */
};

struct source {
    bool live; /* pictures come by themselves */
    char name[64];
    void (*range)(struct source *source, int64_t *oldest, int64_t *newest);
    struct shot *(*take)(struct source *source, int64_t position);
    int64_t (*time)(struct source *source, int64_t position);
    void (*work)(struct source *source);
    void (*state)(struct source *source, struct source_state *state);
    void (*close)(struct source *source);
};

/* What live sources need. */
struct source_limits {
    unsigned frames;
    uint64_t bytes;
};

/*
 * The video item `name` of the store at this port, also one that does not exist yet. `surface` is woken by each
 * picture. NULL: no memory.
 */
struct source *source_item(const char *name, int port, const struct source_limits *limits, struct surface *surface);

/* What source_stream() needs: the options of decode. */
struct source_stream {
    long port;
    const char *group, *interface, *key;
    const char *instance;
    int store; /* port */
};

/* NULL: a setting is wrong, after a line. With `check`, settings are judged and nothing is begun: still NULL, then. */
struct source *source_stream(const struct source_stream *settings, bool check, const struct source_limits *limits,
                             struct surface *surface, int *status);

/* A Y4M file, or all files of its recording. NULL after a line: *status is the program's. */
struct source *source_file(const char *path, int *status);

#endif
