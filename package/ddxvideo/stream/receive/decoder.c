/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decoder.h"

#include <libavutil/pixdesc.h>

#include "payload.h"
#include "picture_convert.h"

/* ---- Pictures in 8-bit 4:2:0, for the item and the window ---- */

static const struct {
    enum AVPixelFormat format, result;
} kinds_of_420[] = {
    {AV_PIX_FMT_YUV420P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_YUV422P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUV420P}, {AV_PIX_FMT_YUVJ444P, AV_PIX_FMT_YUVJ420P},
    {AV_PIX_FMT_GRAY8, AV_PIX_FMT_YUV420P},
};

static enum AVPixelFormat result_of(enum AVPixelFormat format) {
    for (size_t i = 0; i < sizeof kinds_of_420 / sizeof *kinds_of_420; i++)
        if (kinds_of_420[i].format == format)
            return kinds_of_420[i].result;
    return AV_PIX_FMT_NONE;
}

/* Whether pictures of this format are 8-bit 4:2:0 already, or can be converted. */
static bool frame_420_is_possible(enum AVPixelFormat format) {
    return result_of(format) != AV_PIX_FMT_NONE;
}

/* Memory of a picture in this format, in whole pictures of 4:2:0. */
static int frame_420_weight(enum AVPixelFormat format) {
    return result_of(format) == format || format == AV_PIX_FMT_GRAY8 ? 1 : 2;
}

static void frame_420_close(struct frame_420 *to) {
    picture_converter_free(to->converter);
    av_frame_free(&to->frame);
    *to = (struct frame_420){.converter = NULL};
}

static bool set_up(struct frame_420 *to, const AVFrame *picture) {
    const AVPixFmtDescriptor *descriptor = av_pix_fmt_desc_get(picture->format);
    bool grey = descriptor->nb_components == 1;
    const struct picture_kind kind = {.bits = 8,
                                      .chroma_x = grey ? -1 : descriptor->log2_chroma_w,
                                      .chroma_y = grey ? -1 : descriptor->log2_chroma_h};
    const struct ddxvideo_geometry geometry = {
        .width = picture->width & ~1, .height = picture->height & ~1, .fields = 1, .format = DDX_VIDEO_420_MPEG2};

    frame_420_close(to);
    to->format = picture->format;
    to->width = picture->width;
    to->height = picture->height;
    to->frame = av_frame_alloc();
    to->converter = geometry.width && geometry.height ? picture_converter_new(&kind, &geometry) : NULL;
    return to->frame && to->converter;
}

/* The previous converted frame may still be in use by the screen. */
static bool renew_frame(struct frame_420 *to, const AVFrame *picture) {
    av_frame_unref(to->frame);
    to->frame->format = result_of(picture->format);
    to->frame->width = picture->width & ~1;
    to->frame->height = picture->height & ~1;
    return !av_frame_get_buffer(to->frame, 0) && !av_frame_copy_props(to->frame, picture);
}

/* The picture itself, or a copy in 4:2:0, cut to even sides, until the next call. NULL: no memory. */
static const AVFrame *frame_420(struct frame_420 *to, const AVFrame *picture) {
    if (result_of(picture->format) == picture->format)
        return picture;
    bool same =
        to->converter && to->format == picture->format && to->width == picture->width && to->height == picture->height;
    if (!(same || set_up(to, picture)) || !renew_frame(to, picture))
        return NULL;
    const unsigned char *const from[3] = {picture->data[0], picture->data[1], picture->data[2]};
    return picture_convert(to->converter, from, picture->linesize, to->frame->data, to->frame->linesize) ? to->frame
                                                                                                         : NULL;
}

/* ---- Decoder ---- */

_Static_assert(CHUNK_PADDING >= AV_INPUT_BUFFER_PADDING_SIZE, "libavcodec reads so far");

/* libavcodec checks a size that is rounded up by at most this. */
#define ROUNDED_PIXELS (INT64_C(63) * 16384)
/* Pixels of all pictures in use: at most PICTURES times the limit of one picture, or PICTURES_PIXELS_LEAST if that is
 * more. */
#define PICTURES 8
#define PICTURES_PIXELS_LEAST (INT64_C(32) << 20)
#define PICTURES_BESIDE 5 /* pictures in use, in addition to the reference frames */
/* Frames that a renewal may take; after that, another one is requested. */
#define RENEWAL_FRAMES 50
#define SEI 6            /* NAL unit type */
#define RECOVERY_POINT 6 /* first byte of such a NAL unit: the type of the message in it */
#define IDR 5            /* NAL unit type */

/* False: pictures of this size are refused. `weight`: see frame_420_weight(). */
static bool accept_size(struct decoder *decoder, int width, int height, int references, int weight) {
    const struct decoder_limits *limits = &decoder->limits;
    int64_t pixels = (int64_t)width * height, all = limits->pixels * PICTURES;

    if (pixels > limits->pixels)
        decoder->refusal = DECODER_SIZE;
    else if (pixels * weight * (references + PICTURES_BESIDE) >
             (all > PICTURES_PIXELS_LEAST ? all : PICTURES_PIXELS_LEAST))
        decoder->refusal = DECODER_FRAMES;
    else if (limits->even && (width % 2 || height % 2))
        decoder->refusal = DECODER_ODD;
    else
        return true;
    decoder->width = width;
    decoder->height = height;
    return false;
}

static bool refuse_format(struct decoder *decoder) {
    decoder->refusal = DECODER_FORMAT;
    return false;
}

/* libavcodec asks for this with each new parameter set of H.264, before it takes memory for pictures. */
static enum AVPixelFormat choose_format(AVCodecContext *context, const enum AVPixelFormat *formats) {
    struct decoder *decoder = context->opaque;

    while (*formats != AV_PIX_FMT_NONE && !frame_420_is_possible(*formats))
        formats++;
    int weight = *formats == AV_PIX_FMT_NONE ? 1 : frame_420_weight(*formats);
    if (context->width > 0 && !accept_size(decoder, context->width, context->height, context->refs, weight))
        return AV_PIX_FMT_NONE;
    if (*formats == AV_PIX_FMT_NONE)
        refuse_format(decoder);
    return *formats;
}

/* With MPEG-4 libavcodec takes memory first, hence this check. */
static bool accept_mpeg4(struct decoder *decoder, const uint8_t *data, size_t size) {
    struct mpeg4_vol vol;

    if (mpeg4_is_studio(data, size))
        return refuse_format(decoder);
    for (const uint8_t *at = data; mpeg4_next_vol(&at, data + size, &vol);)
        if (!accept_size(decoder, (int)vol.width, (int)vol.height, 1, 1))
            return false;
    return true;
}

int decoder_open(struct decoder *decoder, enum rtp_type type, const struct decoder_limits *limits) {
    const AVCodec *codec = avcodec_find_decoder(type == RTP_H264 ? AV_CODEC_ID_H264 : AV_CODEC_ID_MPEG4);

    decoder_close(decoder);
    if (!codec)
        return AVERROR_DECODER_NOT_FOUND;
    decoder->type = type;
    decoder->limits = *limits;
    decoder->recovering = decoder->wanting = true;
    decoder->context = avcodec_alloc_context3(codec);
    decoder->picture = av_frame_alloc();
    decoder->next = av_frame_alloc();
    decoder->packet = av_packet_alloc();
    if (!decoder->context || !decoder->picture || !decoder->next || !decoder->packet)
        return AVERROR(ENOMEM);
    decoder->context->thread_count = 1; /* each further thread would delay a frame */
    decoder->context->flags |= AV_CODEC_FLAG_LOW_DELAY;
    decoder->context->opaque = decoder;
    decoder->context->get_format = choose_format;
    decoder->context->max_pixels = limits->pixels + ROUNDED_PIXELS;
    return avcodec_open2(decoder->context, codec, NULL);
}

void decoder_close(struct decoder *decoder) {
    avcodec_free_context(&decoder->context);
    av_frame_free(&decoder->picture);
    av_frame_free(&decoder->next);
    av_packet_free(&decoder->packet);
    frame_420_close(&decoder->converted);
    *decoder = (struct decoder){0};
}

/* Whether pictures become whole from this frame on, at once or step by step. */
static bool has_renewal(enum rtp_type type, const uint8_t *data, size_t size) {
    struct h264_nal nal;

    if (type == RTP_MPEG4)
        return codec_can_begin(type, data, size);
    for (const uint8_t *at = data; h264_next_nal(&at, data + size, &nal);) {
        int unit = nal.data[0] & 31;

        if (unit == IDR || (unit == SEI && nal.size > 1 && nal.data[1] == RECOVERY_POINT))
            return true;
    }
    return false;
}

void decoder_lose(struct decoder *decoder) {
    if (!decoder->context)
        return;
    avcodec_flush_buffers(decoder->context);
    decoder->joined = false;
    decoder->recovering = true;
    decoder_want_renewal(decoder);
}

void decoder_want_renewal(struct decoder *decoder) {
    decoder->wanting = true;
    decoder->frames = 0;
}

bool decoder_wants_renewal(const struct decoder *decoder) {
    return decoder->context && decoder->wanting && !decoder->refusal;
}

/* After each decoded frame: whether a renewal is still needed. */
static void follow_renewal(struct decoder *decoder, const uint8_t *data, size_t size) {
    if (has_renewal(decoder->type, data, size)) {
        decoder->wanting = false;
        decoder->frames = 0;
    } else if (decoder->recovering && ++decoder->frames > RENEWAL_FRAMES) {
        decoder_want_renewal(decoder);
    }
}

/* The frame's last picture, if it gives several; NULL if none. */
static const AVFrame *decode_frame(struct decoder *decoder, const uint8_t *data, size_t size) {
    AVFrame *picture = decoder->picture;
    bool found = false;

    decoder->packet->data = (uint8_t *)(uintptr_t)data;
    decoder->packet->size = (int)size;
    int error = avcodec_send_packet(decoder->context, decoder->packet);
    if (error && error != AVERROR(EAGAIN))
        return NULL;
    av_frame_unref(picture);
    while (!avcodec_receive_frame(decoder->context, decoder->next)) {
        av_frame_unref(picture);
        av_frame_move_ref(picture, decoder->next);
        found = true;
    }
    return found && picture->format >= 0 && picture->data[0] ? picture : NULL;
}

/* libavcodec's MPEG-4 decoder gives pictures that refer to missing ones. */
static bool is_whole(const struct decoder *decoder, const AVFrame *picture) {
    return !decoder->recovering || decoder->type == RTP_H264 || picture->pict_type == AV_PICTURE_TYPE_I;
}

/* Whether the decoded picture can be shown. Checked again, since the headers may have had other values. */
static bool accept_picture(struct decoder *decoder, const AVFrame *picture) {
    enum AVPixelFormat format = picture->format;

    return frame_420_is_possible(format)
               ? accept_size(decoder, picture->width, picture->height, 1, frame_420_weight(format))
               : refuse_format(decoder);
}

const AVFrame *decoder_decode(struct decoder *decoder, const uint8_t *data, size_t size, bool *damaged) {
    const AVFrame *picture = NULL;
    enum decoder_refusal before = decoder->refusal;

    if (!decoder->joined)
        decoder->joined = codec_can_begin(decoder->type, data, size);
    if (!decoder->joined || !size)
        return NULL;
    decoder->refusal = DECODER_SHOWS;
    if (decoder->type == RTP_H264 || accept_mpeg4(decoder, data, size))
        picture = decode_frame(decoder, data, size);
    if (picture && !(accept_picture(decoder, picture) && is_whole(decoder, picture)))
        picture = NULL;
    follow_renewal(decoder, data, size);
    if (decoder->refusal) /* the following frames belong to it, up to the next point where a decoder can begin */
        decoder->joined = false;
    if (!picture) {
        decoder->refusal = decoder->refusal ? decoder->refusal : before;
        return NULL;
    }
    picture = frame_420(&decoder->converted, picture);
    if (!picture)
        return NULL;
    decoder->recovering = false;
    *damaged = picture->decode_error_flags || picture->flags & AV_FRAME_FLAG_CORRUPT;
    return picture;
}
