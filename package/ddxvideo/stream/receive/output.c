/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "output.h"

#include <errno.h>
#include <string.h>

#include "ddx_time.h"
#include "ddxvideo.h"
#include "payload.h"

/* ---- A video item ---- */

static struct ddxvideo_geometry geometry_of(const AVFrame *picture, AVRational rate) {
    bool known = ddxvideo_rate_known(rate.num, rate.den); /* the sender's values are not trusted */
    AVRational aspect = picture->sample_aspect_ratio;
    bool has_aspect = aspect.num > 0 && aspect.den > 0;

    return (struct ddxvideo_geometry){.width = picture->width,
                                      .height = picture->height,
                                      .fields = 1,
                                      .rate_num = known ? rate.num : 0,
                                      .rate_den = known ? rate.den : 0,
                                      .aspect_num = has_aspect ? aspect.num : 0,
                                      .aspect_den = has_aspect ? aspect.den : 0,
                                      .format = DDX_VIDEO_420_MPEG2,
                                      .interlacing = 'p',
                                      .range = picture->color_range == AVCOL_RANGE_JPEG ? DDX_VIDEO_RANGE_FULL
                                                                                        : DDX_VIDEO_RANGE_LIMITED};
}

struct ddxvideo_picture output_picture(const AVFrame *frame, AVRational rate) {
    struct ddxvideo_picture picture = {.geometry = geometry_of(frame, rate)};

    for (int i = 0; i < 3; i++) {
        picture.plane[i] = frame->data[i];
        picture.stride[i] = frame->linesize[i];
        picture.rows[i] = i ? (frame->height + 1) / 2 : frame->height;
    }
    return picture;
}

#define CREATE_AGAIN_NS 500000000 /* between attempts, since a store that hangs blocks its clients for seconds */

bool output_is_refused(int error) {
    return error && error != -ECONNREFUSED && error != -ENOBUFS && error != -EMFILE;
}

/* An item for pictures like this one. */
static int choose_item(struct output_item *output, DDX_STORE_ID *id, const struct ddxvideo_geometry *geometry) {
    bool same = ddxvideo_same_layout(&output->geometry, geometry);

    if (output->item && same)
        return 0;
    if (ddx_time_now() < output->create && (same || output->error == -ECONNREFUSED))
        return output->error;
    output_close(output);
    output->geometry = *geometry;
    output->error = ddxvideo_create(id, output->name, geometry, &output->item);
    output->create = output->error ? ddx_time_now() + CREATE_AGAIN_NS : 0;
    return output->error;
}

static void copy_planes(struct ddxvideo_frame *frame, const AVFrame *picture) {
    for (int i = 0; i < 3; i++)
        for (int row = 0; row < frame->rows[i]; row++)
            memcpy(frame->plane[i] + (size_t)row * (size_t)frame->stride[i],
                   picture->data[i] + row * (ptrdiff_t)picture->linesize[i], (size_t)frame->stride[i]);
}

int output_write(struct output_item *output, DDX_STORE_ID *id, const AVFrame *picture, AVRational rate,
                 const struct ddxvideo_stamp *stamp) {
    struct ddxvideo_geometry geometry = geometry_of(picture, rate);
    struct ddxvideo_frame frame;

    if (!output->name)
        return 0;
    if (picture->format != AV_PIX_FMT_YUV420P && picture->format != AV_PIX_FMT_YUVJ420P)
        return -EINVAL;
    int error = choose_item(output, id, &geometry);
    if (error)
        return error;
    error = ddxvideo_loan(output->item, &geometry, &frame);
    if (!error) {
        copy_planes(&frame, picture);
        frame.stamp = *stamp;
        error = ddxvideo_publish(output->item, &frame);
    }
    if (output_is_refused(error)) /* another program writes it now */
        output_close(output);
    return error;
}

void output_close(struct output_item *output) {
    ddx_store_done_item(output->item);
    output->item = NULL;
}

/* ---- An AVI or Matroska file ---- */

#ifdef WITH_AVFORMAT
#include <libavformat/avformat.h>
#include <strings.h>

#define RATE_DEFAULT 25

static const char *extension(const char *path) {
    const char *dot = strrchr(path, '.');

    return dot ? dot + 1 : "";
}

bool movie_is_possible(const char *path) {
    return !strcasecmp(extension(path), "avi") || !strcasecmp(extension(path), "mkv");
}

/* The data that a player begins with: parameter sets, or the headers before the first picture. */
static bool find_parameters(struct chunk *found, const struct assembly_frame *frame) {
    static const uint8_t start_code[] = {0, 0, 0, 1};
    struct h264_nal nal;

    if (frame->type == RTP_MPEG4)
        return chunk_add(found, frame->data, mpeg4_headers(frame->data, frame->size));
    for (const uint8_t *at = frame->data; h264_next_nal(&at, frame->data + frame->size, &nal);) {
        int type = nal.data[0] & 31;

        if ((type == H264_SPS || type == H264_PPS) &&
            (!chunk_add(found, start_code, sizeof start_code) || !chunk_add(found, nal.data, nal.size)))
            return false;
    }
    return true;
}

static int set_parameters(AVCodecParameters *parameters, const struct assembly_frame *frame) {
    struct chunk found = {0};

    if (find_parameters(&found, frame) && found.size)
        parameters->extradata = av_mallocz(found.size + AV_INPUT_BUFFER_PADDING_SIZE);
    if (parameters->extradata) {
        memcpy(parameters->extradata, found.data, found.size);
        parameters->extradata_size = (int)found.size;
    }
    chunk_free(&found);
    return parameters->extradata ? 0 : AVERROR(ENOMEM);
}

static int set_stream(struct movie *movie, const struct assembly_frame *frame, const AVCodecContext *decoder) {
    AVStream *stream = avformat_new_stream(movie->file, NULL);

    if (!stream)
        return AVERROR(ENOMEM);
    AVCodecParameters *parameters = stream->codecpar;
    AVRational rate = decoder->framerate;
    if (!ddxvideo_rate_known(rate.num, rate.den))
        rate = (AVRational){RATE_DEFAULT, 1};
    parameters->codec_type = AVMEDIA_TYPE_VIDEO;
    parameters->codec_id = decoder->codec_id;
    parameters->width = movie->width = decoder->width;
    parameters->height = movie->height = decoder->height;
    parameters->sample_aspect_ratio = decoder->sample_aspect_ratio;
    movie->type = frame->type;
    stream->avg_frame_rate = rate;
    stream->time_base = av_inv_q(rate); /* for AVI; Matroska chooses its own */
    return set_parameters(parameters, frame);
}

static int begin(struct movie *movie, const struct assembly_frame *frame, const AVCodecContext *decoder) {
    const char *format = strcasecmp(extension(movie->path), "avi") ? "matroska" : "avi";

    movie->packet = av_packet_alloc();
    int error = movie->packet ? avformat_alloc_output_context2(&movie->file, NULL, format, NULL) : AVERROR(ENOMEM);
    if (!error)
        error = set_stream(movie, frame, decoder);
    if (!error)
        error = avio_open(&movie->file->pb, movie->path, AVIO_FLAG_WRITE);
    if (error < 0)
        return error;
    movie->last = -1;
    movie->file->flags |= AVFMT_FLAG_FLUSH_PACKETS; /* so that the file has everything received, even after a crash */
    error = avformat_write_header(movie->file, NULL);
    movie->begun = error >= 0;
    return error < 0 ? error : 0;
}

static int write_frame(struct movie *movie, const struct assembly_frame *frame, int64_t time) {
    AVStream *stream = movie->file->streams[0];
    int64_t at = av_rescale_q(time - movie->first, (AVRational){1, SECOND}, stream->time_base);

    if (at <= movie->last) /* two frames within a unit */
        at = movie->last + 1;
    AVPacket *packet = movie->packet;
    packet->data = (uint8_t *)(uintptr_t)frame->data;
    packet->size = (int)frame->size;
    packet->pts = packet->dts = movie->last = at;
    packet->duration = av_rescale_q(1, av_inv_q(stream->avg_frame_rate), stream->time_base);
    packet->flags = codec_can_begin(frame->type, frame->data, frame->size) ? AV_PKT_FLAG_KEY : 0;
    packet->stream_index = 0;
    return av_write_frame(movie->file, packet);
}

int movie_add(struct movie *movie, const struct assembly_frame *frame, int64_t time, const AVCodecContext *decoder) {
    if (!movie->path || movie->ended || !frame->size)
        return 0;
    int error = 0;
    if (!movie->file) {
        if (decoder->width <= 0 || !codec_can_begin(frame->type, frame->data, frame->size))
            return 0;
        movie->first = time;
        error = begin(movie, frame, decoder);
    }
    if (!error && decoder->width > 0 &&
        (frame->type != movie->type || decoder->width != movie->width || decoder->height != movie->height))
        error = AVERROR_INPUT_CHANGED;
    if (!error)
        error = write_frame(movie, frame, time);
    if (error < 0)
        movie_close(movie);
    return error < 0 ? error : 0;
}

int movie_close(struct movie *movie) {
    int error = 0;

    movie->ended = true;
    if (movie->file && movie->file->pb) {
        error = movie->begun ? av_write_trailer(movie->file) : 0;
        int closed = avio_closep(&movie->file->pb);
        error = error < 0 ? error : closed;
    }
    avformat_free_context(movie->file);
    movie->file = NULL;
    av_packet_free(&movie->packet);
    return error;
}

#else

bool movie_is_possible(const char *path) {
    (void)path;
    return false;
}

int movie_add(struct movie *movie, const struct assembly_frame *frame, int64_t time, const AVCodecContext *decoder) {
    (void)movie;
    (void)frame;
    (void)time;
    (void)decoder;
    return 0;
}

int movie_close(struct movie *movie) {
    (void)movie;
    return 0;
}

#endif
