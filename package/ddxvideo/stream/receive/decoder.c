/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decoder.h"

#include "chunk.h"
#include "h264.h"

_Static_assert(CHUNK_PADDING >= AV_INPUT_BUFFER_PADDING_SIZE, "libavcodec reads so far");

int decoder_open(struct decoder *decoder, enum rtp_type type) {
    const AVCodec *codec = avcodec_find_decoder(type == RTP_H264 ? AV_CODEC_ID_H264 : AV_CODEC_ID_MPEG4);

    decoder_close(decoder);
    if (!codec)
        return AVERROR_DECODER_NOT_FOUND;
    decoder->type = type;
    decoder->context = avcodec_alloc_context3(codec);
    decoder->picture = av_frame_alloc();
    decoder->next = av_frame_alloc();
    decoder->packet = av_packet_alloc();
    if (!decoder->context || !decoder->picture || !decoder->next || !decoder->packet)
        return AVERROR(ENOMEM);
    decoder->context->thread_count = 1; /* each thread more would keep a frame back */
    decoder->context->flags |= AV_CODEC_FLAG_LOW_DELAY;
    return avcodec_open2(decoder->context, codec, NULL);
}

void decoder_close(struct decoder *decoder) {
    avcodec_free_context(&decoder->context);
    av_frame_free(&decoder->picture);
    av_frame_free(&decoder->next);
    av_packet_free(&decoder->packet);
    *decoder = (struct decoder){0};
}

bool decoder_can_begin(enum rtp_type type, const uint8_t *data, size_t size) {
    struct h264_nal nal;

    for (const uint8_t *at = data; h264_next_nal(&at, data + size, &nal);) /* MPEG-4's start codes look the same */
        if (type == RTP_H264 ? (nal.data[0] & 31) == H264_SPS : (nal.data[0] & 0xf0) == 0x20)
            return true;
    return false;
}

const AVFrame *decoder_decode(struct decoder *decoder, const uint8_t *data, size_t size, bool *damaged) {
    if (!decoder->joined)
        decoder->joined = decoder_can_begin(decoder->type, data, size);
    if (!decoder->joined || !size)
        return NULL;
    decoder->packet->data = (uint8_t *)(uintptr_t)data;
    decoder->packet->size = (int)size;
    int error = avcodec_send_packet(decoder->context, decoder->packet);
    if (error && error != AVERROR(EAGAIN))
        return NULL;
    bool found = false;
    AVFrame *picture = decoder->picture;
    av_frame_unref(picture);
    while (!avcodec_receive_frame(decoder->context, decoder->next)) { /* the last one, should there be several */
        av_frame_unref(picture);
        av_frame_move_ref(picture, decoder->next);
        found = true;
    }
    if (!found || picture->format < 0 || !picture->data[0])
        return NULL;
    *damaged = picture->decode_error_flags || picture->flags & AV_FRAME_FLAG_CORRUPT;
    return picture;
}
