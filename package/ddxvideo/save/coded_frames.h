/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Turns pictures into the frames of an MP4 file: key frames, stamps, and the times at which players show them. */
#ifndef DDXVIDEO_CODED_FRAMES_H
#define DDXVIDEO_CODED_FRAMES_H

#include <sys/uio.h>

#include "h264_encode.h"
#include "mp4_times.h"
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
    bool failed; /* the encoder, at the last picture */
};

/* A frame in pieces: block 0 if it is the first one, the begin of the fragment, and the encoded picture. */
struct coded_frame {
    struct iovec piece[3]; /* valid until the next frame */
    uint32_t step;         /* struct mp4_entry */
};

/* Errors are those of h264_encoder_open(). Close it in any case. */
int coded_frames_open(struct coded_frames *frames, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings);
void coded_frames_close(struct coded_frames *frames);

/* Bytes that any frame fits into, block 0 included. */
size_t coded_frames_room(const struct ddxvideo_geometry *geometry);

/* Whether a frame with this capture time comes so long after the last one that a file cannot express it. */
bool coded_frames_is_gap(const struct coded_frames *frames, int64_t time);

/* Change the quality, if it is not lossless, from the next frame on. */
void coded_frames_set_quality(struct coded_frames *frames, long quality);

/* The next frame begins another file, with block 0 and a key frame. */
void coded_frames_next_file(struct coded_frames *frames);

/*
 * Encode a picture with this stamp; its `key` and `geometry` are set here. 0, or -EIO: the encoder failed. Then the
 * next frame is a key frame, so that no picture refers to the missing one.
 */
int coded_frames_next(struct coded_frames *frames, const struct ddxvideo_picture *picture, struct stamp *stamp,
                      struct coded_frame *frame);

#endif
