/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where a received stream goes besides the screen: decoded into a video item of this machine's store, into a file. */
#ifndef DDXVIDEO_DECODE_OUTPUT_H
#define DDXVIDEO_DECODE_OUTPUT_H

#include <ddxvideo.h>
#include <libavcodec/avcodec.h>
#include <libavutil/frame.h>
#include <stdbool.h>

#include "stream_rx.h"

/* ---- A video item ---- */

struct output_item {
    const char *name; /* NULL: none */
    DDX_STORE_ITEM *item;
    struct ddxvideo_geometry geometry; /* of the item */
    int64_t create;                    /* earliest time of the next attempt */
    int error;                         /* why the last attempt failed */
};

/* A decoded picture as it is in a video item: geometry and planes, which stay the frame's. */
struct ddxvideo_picture output_picture(const AVFrame *frame, AVRational rate);

/* Whether an error means that the store runs, but refuses such pictures, at least for now. */
bool output_is_refused(int error);

/* Write the picture. 0, or -errno; in each case the next picture can be tried. */
int output_write(struct output_item *output, DDX_STORE_ID *id, const AVFrame *picture, AVRational rate,
                 const struct ddxvideo_stamp *stamp);

void output_close(struct output_item *output);

/* ---- An AVI or Matroska file, with the frames as they came ---- */

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
