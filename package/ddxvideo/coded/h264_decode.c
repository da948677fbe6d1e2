/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "h264_decode.h"

#include <errno.h>
#include <string.h>

#include "mp4_read.h"
#include "video_layout.h"

/* libavcodec checks a size that is rounded up by at most this. */
#define ROUNDED (INT64_C(63) * 16384)

/* The decoder takes the parameter sets in the form of the file's `avcC`. */
static int take_sets(AVCodecContext *codec, const struct mp4_format *format) {
    uint8_t block[MP4_BLOCK];
    size_t size;

    mp4_write_head(block, format);
    const uint8_t *record = mp4_decoder_record(block, &size);
    codec->extradata = av_mallocz(size + AV_INPUT_BUFFER_PADDING_SIZE);
    if (!codec->extradata)
        return -ENOMEM;
    memcpy(codec->extradata, record, size);
    codec->extradata_size = (int)size;
    return 0;
}

int h264_decoder_open(struct h264_decoder *decoder, const struct mp4_format *format, int threads) {
    const AVCodec *codec = avcodec_find_decoder(AV_CODEC_ID_H264);

    *decoder = (struct h264_decoder){
        .packet = av_packet_alloc(), .frame = av_frame_alloc(), .codec = codec ? avcodec_alloc_context3(codec) : NULL};
    if (!codec)
        return -ENOSYS;
    AVCodecContext *context = decoder->codec;
    if (!decoder->packet || !decoder->frame || !context || take_sets(context, format))
        return -ENOMEM;
    context->max_pixels = (int64_t)format->width * format->height + ROUNDED;
    context->thread_count = threads;
    context->thread_type = FF_THREAD_FRAME;
    context->flags |= AV_CODEC_FLAG_LOW_DELAY;
    context->flags2 |= AV_CODEC_FLAG2_SHOW_ALL;
    context->err_recognition = AV_EF_CRCCHECK | AV_EF_BITSTREAM | AV_EF_BUFFER | AV_EF_EXPLODE;
    context->error_concealment = 0;
    return avcodec_open2(context, codec, NULL) < 0 ? -EBADMSG : 0;
}

const char *h264_decoder_error(int error) {
    return error == -ENOSYS   ? "cannot be decoded: libavcodec has no H.264"
           : error == -ENOMEM ? "cannot be decoded: out of memory"
                              : "bad parameters of H.264; the file is damaged";
}

void h264_decoder_close(struct h264_decoder *decoder) {
    avcodec_free_context(&decoder->codec);
    av_packet_free(&decoder->packet);
    av_frame_free(&decoder->frame);
}

uint8_t *h264_decoder_room(struct h264_decoder *decoder, uint32_t bytes) {
    av_packet_unref(decoder->packet);
    return bytes <= INT32_MAX / 2 && !av_new_packet(decoder->packet, (int)bytes) ? decoder->packet->data : NULL;
}

bool h264_decoder_look(struct h264_decoder *decoder, const struct mp4_format *format, struct stamp *stamp) {
    if (!stamp_read(decoder->packet->data, (size_t)decoder->packet->size, stamp) || !stamp->key ||
        stamp->geometry.width != format->width || stamp->geometry.height != format->height)
        return false;
    decoder->geometry = stamp->geometry;
    if (!ddxvideo_rate_known(decoder->geometry.rate_num, decoder->geometry.rate_den))
        decoder->geometry.rate_num = decoder->geometry.rate_den = 0;
    return true;
}

/* Whether a decoded picture is of the recorded geometry. */
static bool fits(const AVFrame *frame, const struct ddxvideo_geometry *geometry) {
    static const int formats[3][2] = {{AV_PIX_FMT_YUV420P, AV_PIX_FMT_YUVJ420P},
                                      {AV_PIX_FMT_YUV422P, AV_PIX_FMT_YUVJ422P},
                                      {AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUVJ444P}};
    int chroma = geometry->format == DDX_VIDEO_YUV422P ? 1 : geometry->format == DDX_VIDEO_YUV444P ? 2 : 0;

    return frame->width == geometry->width && frame->height == geometry->height &&
           (frame->format == formats[chroma][0] || frame->format == formats[chroma][1]);
}

/* Whether the decoded picture is undamaged. */
static bool is_good(const struct h264_decoder *decoder) {
    return !decoder->frame->decode_error_flags && !(decoder->frame->flags & AV_FRAME_FLAG_CORRUPT) &&
           fits(decoder->frame, &decoder->geometry);
}

static bool decode(struct h264_decoder *decoder) {
    int error = avcodec_send_packet(decoder->codec, decoder->packet);

    if (!error)
        error = avcodec_receive_frame(decoder->codec, decoder->frame);
    if (!error && is_good(decoder))
        return true;
    while (!avcodec_receive_frame(decoder->codec, decoder->frame))
        continue;
    return false;
}

bool h264_decode(struct h264_decoder *decoder, bool key, struct stamp *stamp) {
    bool stamped = stamp_read(decoder->packet->data, (size_t)decoder->packet->size, stamp);

    if (!stamped)
        stamp->time = -1;
    if (key && decoder->waits)
        avcodec_flush_buffers(decoder->codec);
    decoder->waits = (decoder->waits && !key) || !stamped || !decode(decoder);
    return !decoder->waits;
}

bool h264_decode_many(struct h264_decoder *decoder, bool last, bool (*take)(void *argument), void *argument) {
    struct stamp stamp;

    if (!stamp_read(decoder->packet->data, (size_t)decoder->packet->size, &stamp))
        return false;
    int error = avcodec_send_packet(decoder->codec, decoder->packet);
    if (!error && last)
        error = avcodec_send_packet(decoder->codec, NULL);
    while (!error && !(error = avcodec_receive_frame(decoder->codec, decoder->frame)))
        if (!is_good(decoder) || !take(argument))
            return false;
    return error == (last ? AVERROR_EOF : AVERROR(EAGAIN));
}

void h264_decoder_rewind(struct h264_decoder *decoder) {
    avcodec_flush_buffers(decoder->codec);
    decoder->waits = false;
}

void h264_decoder_copy(const struct h264_decoder *decoder, unsigned char *const plane[3]) {
    const struct ddxvideo_geometry *geometry = &decoder->geometry;
    const struct video_layout *layout = video_layout_of(geometry->format);
    int stride, rows;

    for (int i = 0; i < 3; i++) {
        video_layout_plane(layout, geometry->width, geometry->height, i, &stride, &rows);
        for (int row = 0; row < rows; row++)
            memcpy(plane[i] + (size_t)row * (size_t)stride,
                   decoder->frame->data[i] + (ptrdiff_t)row * decoder->frame->linesize[i], (size_t)stride);
    }
}
