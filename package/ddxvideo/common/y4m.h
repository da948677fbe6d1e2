/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Y4M (YUV4MPEG2): reads all of its chroma layouts, writes those of the store, except RGB24.
 *
 * Our own parameters: `XDDX_FIELDS=<n>` (stacked fields) in the header; `XTIME=<ns>` on each FRAME line, the time
 * since the file's first frame; on the first FRAME line also `XDDX_START=<ns>` and `XDDX_WALL=<ns>`, the monotonic
 * and the wall time of that frame. They are not in the header because players refuse long lines: GStreamer 1.22
 * above 80 bytes, FFmpeg 5 above 96, and above 80 on FRAME lines.
 */
#ifndef DDXVIDEO_Y4M_H
#define DDXVIDEO_Y4M_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "ddxvideo.h"

#define Y4M_MAGIC "YUV4MPEG2"
#define Y4M_LINE_PLAYED 80        /* every player reads shorter lines, line feed included */
#define Y4M_HEADER_MAX 1024       /* bytes of the first line, at most */
#define Y4M_FRAME_LINE_MAX 256    /* bytes of a FRAME line, at most */
#define Y4M_HEADER_WRITTEN 97     /* room to write a header line, even with a frame rate of 20 digits */
#define Y4M_FRAME_LINE_WRITTEN 80 /* room to write a FRAME line, with its line feed */
#define Y4M_ERROR_MAX 200
#define Y4M_TIME_MAX INT64_C(1000000000000000000)

/* A chroma layout of a file. */
struct y4m_layout {
    const char *tag;        /* after the C */
    int format;             /* enum ddx_video_format of its pictures in the store, converted to 4:2:0 */
    int same;               /* that of the store's layout with the same bytes; -1: there is none */
    int bits;               /* of a sample; above 8 they are 16-bit little endian */
    int chroma_x, chroma_y; /* log2 of the subsampling; -1: no chroma at all */
    bool alpha;             /* a fourth plane, ignored */
};

struct y4m_header {
    struct ddxvideo_geometry geometry; /* as in the store */
    const struct y4m_layout *layout;
    int range; /* enum ddx_video_range, as the file says */
};

/* Whether the file's planes are those of the store, byte for byte. */
bool y4m_is_plain(const struct y4m_header *header);

/* Whether pictures of this enum ddx_video_format can be written into a file unchanged. */
bool y4m_has(int format);

/* Bytes of plane 0 to 3 in the file, 0 for a plane that the layout does not have. */
size_t y4m_plane_bytes(const struct y4m_header *header, int plane);

#define Y4M_SAME -1 /* in the layout of the file if the store has it, otherwise in 4:2:0 */

/*
 * Parse a header line without its line feed; an impossible frame rate becomes 0/0, unknown. `format`: enum
 * ddx_video_format of the wanted pictures, or Y4M_SAME; which 4:2:0 it is depends on the file. False and one clear text
 * in error[Y4M_ERROR_MAX] ("what, what to do") if it cannot be played.
 */
bool y4m_parse_header(const char *line, int format, struct y4m_header *header, char *error);

/* Parse a FRAME line without its line feed; *time is its XTIME or -1. False and a text as above. */
bool y4m_parse_frame(const char *line, int64_t *time, char *error);

/* XDDX_START of a FRAME line, or -1. */
int64_t y4m_parse_start(const char *line);

/* Header line with line feed, for a format that y4m_has(); returns its length. */
size_t y4m_write_header(char line[Y4M_HEADER_WRITTEN], const struct ddxvideo_geometry *geometry);

/* FRAME line with line feed; returns its length. `start` and `wall` are of the first frame; left out where 0 or
 * less. */
size_t y4m_write_frame(char line[Y4M_FRAME_LINE_WRITTEN], int64_t time, int64_t start, int64_t wall);

/* ---- Reading a file ---- */

struct picture_converter;

struct y4m_reader {
    struct y4m_header header;
    int64_t frames;            /* whole frames read in this pass */
    int64_t start;             /* CLOCK_MONOTONIC of the first frame when it was recorded; -1: not known */
    bool cut;                  /* the last failure: the file ends within a frame */
    char error[Y4M_ERROR_MAX]; /* of the last failure */
    /* private: */
    int fd;
    bool at_end, waits;            /* waits: not a regular file */
    size_t ahead_begin, ahead_end; /* bytes of `ahead` not used yet */
    char ahead[Y4M_HEADER_MAX];
    unsigned char *scratch; /* a frame in the file's layout, if that is not the store's */
    struct picture_converter *converter;
};

enum y4m_result {
    Y4M_OK,
    Y4M_END,  /* no more frames */
    Y4M_BAD,  /* bad input */
    Y4M_ERROR /* a system error: memory, disk */
};

/* For the whole program: once this returns true, reading from an idle pipe stops as at the end of a file. */
void y4m_stop_when(bool (*stopping)(void));

/*
 * Open and read the header; `format` as for y4m_parse_header(). `-` is standard input. Call
 * y4m_close() in any case.
 */
enum y4m_result y4m_open(struct y4m_reader *reader, const char *path, int format);
void y4m_close(struct y4m_reader *reader);

/*
 * Read the next frame into planes without padding, of header.geometry; *time is its XTIME or -1. On any other
 * result than Y4M_OK the planes are undefined. A frame cut short is Y4M_BAD.
 */
enum y4m_result y4m_read(struct y4m_reader *reader, unsigned char *const plane[3], int64_t *time);

/* For files that are not y4m_is_plain(); NULL: no memory. The caller frees it with picture_converter_free(). */
struct picture_converter *y4m_converter(const struct y4m_header *header);

/*
 * A picture in the file's layout, whose planes lie one after the other at `from`, into planes without padding;
 * PICTURE_READ_BEYOND bytes after it are readable. False if it failed.
 */
bool y4m_convert(const struct y4m_header *header, struct picture_converter *converter, const unsigned char *from,
                 unsigned char *const plane[3]);

/* Back to the first frame. Y4M_BAD for input that cannot be rewound (a pipe). */
enum y4m_result y4m_rewind(struct y4m_reader *reader);

#endif
