/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * H.264 by x264, for recordings: one thread, no B frames, preset ultrafast. The caller decides which frames are key
 * frames; each can be decoded from the last key frame on.
 */
#ifndef DDXVIDEO_H264_ENCODE_H
#define DDXVIDEO_H264_ENCODE_H

#include <stdint.h>
#include <x264.h>

#include "ddxvideo.h"
#include "mp4_write.h"

#define H264_ROOM 4096 /* bytes that a frame of a few pixels may have, beside twice those of the picture */

struct h264_settings {
    long quality; /* x264's crf, 10 to 40; 0: lossless */
    long bitrate; /* kbit/s at most, over a second; 0: as many as it takes. Not with lossless */
};

struct h264_encoder {
    x264_t *x264; /* NULL: not open */
    struct ddxvideo_geometry geometry;
    uint8_t *grey; /* chroma of grey pictures: a plane of 128 */
    int64_t number;
};

/* NULL if pictures of this geometry can be encoded; otherwise the reason, as a static text. */
const char *h264_refusal(const struct ddxvideo_geometry *geometry);

/*
 * Begin to encode pictures of this geometry, which h264_refusal() takes; *format becomes that of the MP4 file. 0,
 * -ENOMEM, or -EIO: x264 failed. Close it in any case.
 */
int h264_encoder_open(struct h264_encoder *encoder, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings, struct mp4_format *format);
void h264_encoder_close(struct h264_encoder *encoder);

/* Change the crf of an encoder that is not lossless, from the next picture on. */
void h264_encoder_set_quality(struct h264_encoder *encoder, long quality);

/*
 * Encode a picture. *data: NAL units with lengths of 4 bytes, valid until the next call. 0, or -EIO: then the next
 * picture must be a key frame.
 */
int h264_encode(struct h264_encoder *encoder, const struct ddxvideo_picture *picture, bool key, const uint8_t **data,
                size_t *size);

#endif
