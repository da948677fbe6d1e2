/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Turns pictures into the frames of an MP4 file: key frames, stamps, and the times at which players show them. */
#ifndef DDXVIDEO_CODED_FRAMES_H
#define DDXVIDEO_CODED_FRAMES_H

#include <sys/uio.h>

#include "h264_encode.h"
#include "mp4_write.h"
#include "stamp.h"

struct coded_frames {
    struct mp4_format format;
    /* private: */
    struct h264_encoder encoder;
    uint8_t head[MP4_BLOCK];
    uint8_t begin[MP4_FRAGMENT];
    uint32_t number; /* of frames in this file so far */
    struct mp4_times times;
    int64_t key; /* capture time of the last key frame */
    bool begins; /* the next frame must do without the ones before */
    bool coarse; /* quality gives way */
    long quality;
    uint8_t stamp[STAMP_NAL_MAX];
};

struct coded_picture {
    const uint8_t *data;
    size_t size;
    bool key;
};

/* A frame in pieces: block 0 if it is the first one, the begin of the fragment, the stamp, and the encoded picture. */
#define CODED_PIECES 4
struct coded_frame {
    struct iovec piece[CODED_PIECES]; /* valid until the next frame */
    size_t bytes;
    uint32_t step; /* struct mp4_entry */
};

/* Errors are those of h264_encoder_open(). Close it in any case. */
int coded_frames_open(struct coded_frames *frames, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings);
void coded_frames_close(struct coded_frames *frames);

#define CODED_EXTRA (MP4_FRAGMENT + STAMP_NAL_MAX) /* most bytes of a frame beside its picture */

/* Bytes that any frame fits into, block 0 included. */
size_t coded_frames_room(const struct ddxvideo_geometry *geometry);

/* Whether a frame with this capture time comes so long after the last one that a file cannot express it. */
bool coded_frames_is_gap(const struct coded_frames *frames, int64_t time);

/*
 * Before a picture: quality gives way, unless it is lossless, while frames come late or the queue fills; `percent` is
 * the worse of both. Returns whether it does.
 */
bool coded_frames_give_way(struct coded_frames *frames, unsigned percent);

/* The next picture to be encoded becomes a key frame, because no picture may refer to the ones before. */
void coded_frames_need_key(struct coded_frames *frames);

/* The next frame begins another file, with block 0 and a key frame. */
void coded_frames_next_file(struct coded_frames *frames);

/*
 * Encode a picture that was captured then; *coded is valid until the next one. 0, or -EIO: the encoder failed. Then the
 * next picture becomes a key frame, so that no picture refers to the missing one.
 */
int coded_frames_encode(struct coded_frames *frames, const struct ddxvideo_picture *picture, int64_t time,
                        struct coded_picture *coded);

/*
 * Make the next frame of the file from an encoded picture and this stamp, whose `key` and `geometry` are set here.
 * Pictures are added in the order in which they were encoded; the first one of a file is a key frame.
 */
void coded_frames_add(struct coded_frames *frames, const struct coded_picture *coded, struct stamp *stamp,
                      struct coded_frame *frame);

#endif
