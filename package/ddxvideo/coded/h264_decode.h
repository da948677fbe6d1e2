/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Decodes MP4 recordings by libavcodec, exactly: a damaged picture is an error, not a guess. */
#ifndef DDXVIDEO_H264_DECODE_H
#define DDXVIDEO_H264_DECODE_H

#include <libavcodec/avcodec.h>

#include "mp4_write.h"
#include "stamp.h"

struct h264_decoder {
    struct ddxvideo_geometry geometry; /* of the pictures, as recorded; from h264_decoder_look() on */
    AVFrame *frame;                    /* the decoded picture */
    /* private: */
    AVCodecContext *codec;
    AVPacket *packet;
    bool waits; /* a frame was damaged: the next ones refer to it, up to a key frame */
};

/*
 * 0; -ENOMEM; -ENOSYS: libavcodec has no H.264; -EBADMSG: bad parameter sets. Close it in any case. With several
 * threads: for h264_decode_many() only.
 */
int h264_decoder_open(struct h264_decoder *decoder, const struct mp4_format *format, int threads);
/* The text of such an error. */
const char *h264_decoder_error(int error);
void h264_decoder_close(struct h264_decoder *decoder);

/* Memory for the bytes of a frame, valid until the next call. NULL: no memory. */
uint8_t *h264_decoder_room(struct h264_decoder *decoder, uint32_t bytes);

/* Take the geometry from the stamp of a file's first frame, whose bytes are in the room. False: it has none. */
bool h264_decoder_look(struct h264_decoder *decoder, const struct mp4_format *format, struct stamp *stamp);

/*
 * Decode the frame whose bytes are in the room. False: it is damaged, or refers to a damaged one. The stamp's time is
 * -1 if it has none.
 */
bool h264_decode(struct h264_decoder *decoder, bool key, struct stamp *stamp);

/*
 * Decode the frame whose bytes are in the room beside others, in several threads: `take` is called for each picture
 * that is done, in the order of the frames; with `last` for all of them. False: one is damaged, or `take` returned
 * false. Before a key frame that does not follow, call h264_decoder_rewind().
 */
bool h264_decode_many(struct h264_decoder *decoder, bool last, bool (*take)(void *argument), void *argument);

/* Start at a key frame again. */
void h264_decoder_rewind(struct h264_decoder *decoder);

/* Copy the decoded picture into planes without padding. */
void h264_decoder_copy(const struct h264_decoder *decoder, unsigned char *const plane[3]);

#endif
