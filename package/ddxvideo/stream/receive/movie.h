/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Writes the stream into an AVI or Matroska file, without decoding it. */
#ifndef DDXVIDEO_MOVIE_H
#define DDXVIDEO_MOVIE_H

#include <libavcodec/avcodec.h>
#include <stdbool.h>

#include "stream_rx.h"

struct AVFormatContext;

struct movie {
    const char *path;             /* NULL: none */
    struct AVFormatContext *file; /* NULL: not begun, or ended */
    AVPacket *packet;
    enum rtp_type type;
    int width, height;
    int64_t first, last; /* time of the first frame, ns; of the last one, in the file's units */
    bool begun, ended;
};

/* Whether files of this name can be written: .avi and .mkv. */
bool movie_is_possible(const char *path);

/*
 * Add a frame; the file begins with the first one that a player can begin with. `time`: ns, of any clock. `decoder`:
 * has decoded the frame, and knows size and rate. 0, or a negative AVERROR, only once: then the file has ended.
 */
int movie_add(struct movie *movie, const struct assembly_frame *frame, int64_t time, const AVCodecContext *decoder);

/* Finish the file. 0, or a negative AVERROR. */
int movie_close(struct movie *movie);

#endif
