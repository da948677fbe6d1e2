/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "clip.h"

#include <errno.h>
#include <fcntl.h>
#include <libavcodec/avcodec.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mp4_read.h"
#include "picture_convert.h"
#include "stamp.h"
#include "video_layout.h"

/* libavcodec checks a size that is rounded up by at most this. */
#define ROUNDED (INT64_C(63) * 16384)

struct clip_mp4 {
    int fd;
    struct mp4_file file;
    struct ddxvideo_geometry source; /* as recorded */
    AVCodecContext *codec;
    AVPacket *packet;
    AVFrame *frame;
    struct picture_converter *converter; /* NULL: the planes are copied */
    bool waits;                          /* a frame was damaged: the next ones refer to it, up to a key frame */
};

#define MAKE_ONE "make one: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m"

__attribute__((format(printf, 3, 4))) static enum clip_result fail(struct clip *clip, enum clip_result result,
                                                                   const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(clip->error, sizeof clip->error, format, arguments);
    va_end(arguments);
    return result;
}

/* ---- Y4M ---- */

static enum clip_result of_y4m(struct clip *clip, enum y4m_result result) {
    static const enum clip_result results[] = {
        [Y4M_OK] = CLIP_OK, [Y4M_END] = CLIP_END, [Y4M_BAD] = CLIP_BAD, [Y4M_ERROR] = CLIP_ERROR};

    clip->geometry = clip->y4m.header.geometry;
    clip->frames = clip->y4m.frames;
    clip->start = clip->y4m.start;
    clip->cut = clip->y4m.cut;
    memcpy(clip->error, clip->y4m.error, sizeof clip->error);
    return results[result];
}

/* ---- H.264 ---- */

/* The exact decoder: one thread, no delay, and an error for each damaged picture instead of a guess. */
static enum clip_result open_decoder(struct clip *clip) {
    struct clip_mp4 *mp4 = clip->mp4;
    uint8_t block[MP4_BLOCK];
    const AVCodec *codec = avcodec_find_decoder(AV_CODEC_ID_H264);

    mp4->packet = av_packet_alloc();
    mp4->frame = av_frame_alloc();
    mp4->codec = codec ? avcodec_alloc_context3(codec) : NULL;
    if (!codec)
        return fail(clip, CLIP_ERROR, "cannot be decoded: libavcodec has no H.264");
    if (!mp4->packet || !mp4->frame || !mp4->codec)
        return fail(clip, CLIP_ERROR, "cannot be decoded: out of memory");
    /* The decoder takes the parameter sets in the form of the file's `avcC`. */
    mp4_write_head(block, &mp4->file.format);
    size_t size;
    const uint8_t *record = mp4_decoder_record(block, &size);
    mp4->codec->extradata = av_mallocz(size + AV_INPUT_BUFFER_PADDING_SIZE);
    if (!mp4->codec->extradata)
        return fail(clip, CLIP_ERROR, "cannot be decoded: out of memory");
    memcpy(mp4->codec->extradata, record, size);
    mp4->codec->extradata_size = (int)size;
    mp4->codec->max_pixels = (int64_t)mp4->file.format.width * mp4->file.format.height + ROUNDED;
    mp4->codec->thread_count = 1;
    mp4->codec->flags |= AV_CODEC_FLAG_LOW_DELAY;
    mp4->codec->flags2 |= AV_CODEC_FLAG2_SHOW_ALL;
    mp4->codec->err_recognition = AV_EF_CRCCHECK | AV_EF_BITSTREAM | AV_EF_BUFFER | AV_EF_EXPLODE;
    mp4->codec->error_concealment = 0;
    if (avcodec_open2(mp4->codec, codec, NULL) < 0)
        return fail(clip, CLIP_BAD, "bad parameters of H.264; the file is damaged");
    return CLIP_OK;
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

/* Decodes the packet. False: damaged. */
static bool decode(struct clip_mp4 *mp4) {
    int error = avcodec_send_packet(mp4->codec, mp4->packet);

    if (!error)
        error = avcodec_receive_frame(mp4->codec, mp4->frame);
    if (!error && !mp4->frame->decode_error_flags && !(mp4->frame->flags & AV_FRAME_FLAG_CORRUPT) &&
        fits(mp4->frame, &mp4->source))
        return true;
    while (!avcodec_receive_frame(mp4->codec, mp4->frame))
        continue;
    return false;
}

/* ---- MP4 ---- */

/* The next frame's bytes, into the packet. */
static enum clip_result take_packet(struct clip *clip, struct mp4_fragment *fragment) {
    struct clip_mp4 *mp4 = clip->mp4;
    long long number = (long long)mp4->file.frames;

    switch (mp4_next_frame(&mp4->file, fragment)) {
    case MP4_FRAME: break;
    case MP4_END: return CLIP_END;
    case MP4_CUT:
        clip->cut = true;
        return fail(clip, CLIP_BAD, "cut short in frame %lld (from 0); the frames before it are whole", number);
    case MP4_DAMAGED:
        return fail(clip, CLIP_BAD, "frame %lld: nothing of the kind is where it should begin; the file is damaged",
                    number);
    }
    av_packet_unref(mp4->packet);
    if (fragment->bytes > INT32_MAX / 2 || av_new_packet(mp4->packet, (int)fragment->bytes) < 0)
        return fail(clip, CLIP_ERROR, "frame %lld: no memory for %u bytes", number, fragment->bytes);
    int error = mp4_read_bytes(&mp4->file, fragment, mp4->packet->data);
    if (error)
        return fail(clip, CLIP_ERROR, "cannot be read: %s", error == -ENODATA ? "it became shorter" : strerror(-error));
    return CLIP_OK;
}

/* The layout that pictures of this one get; as for Y4M. */
static int choose_format(int recorded, int wanted) {
    if (wanted == Y4M_SAME || (video_layout_is_420(wanted) && video_layout_is_420(recorded)))
        return recorded;
    if (!video_layout_is_420(wanted))
        return wanted;
    return recorded == DDX_VIDEO_GREY8 ? DDX_VIDEO_420_JPEG : DDX_VIDEO_420_MPEG2;
}

/* The geometry is in the first frame. */
static enum clip_result look_at_first(struct clip *clip, int format) {
    struct clip_mp4 *mp4 = clip->mp4;
    struct mp4_fragment fragment;
    struct stamp stamp;
    enum clip_result result = take_packet(clip, &fragment);

    if (result == CLIP_END || (result == CLIP_BAD && clip->cut))
        return fail(clip, CLIP_BAD, "has no frame; record or copy it again");
    if (result != CLIP_OK)
        return result;
    if (!stamp_read(mp4->packet->data, (size_t)mp4->packet->size, &stamp) || !stamp.key ||
        stamp.geometry.width != mp4->file.format.width || stamp.geometry.height != mp4->file.format.height)
        return fail(clip, CLIP_BAD, "its first frame does not tell the layout of the pictures; the file is damaged");
    mp4->source = clip->geometry = stamp.geometry;
    clip->geometry.format = choose_format(stamp.geometry.format, format);
    if (clip->geometry.format == DDX_VIDEO_RGB24) /* has no other range */
        clip->geometry.range = DDX_VIDEO_RANGE_FULL;
    if (!ddxvideo_rate_known(clip->geometry.rate_num, clip->geometry.rate_den))
        clip->geometry.rate_num = clip->geometry.rate_den = 0;
    clip->start = stamp.time > 0 ? stamp.time : -1;
    mp4_rewind(&mp4->file);
    if (clip->geometry.format == mp4->source.format)
        return CLIP_OK;
    const struct picture_kind kind = picture_kind_of(&mp4->source);
    mp4->converter = picture_converter_new(&kind, &clip->geometry);
    if (!mp4->converter)
        return fail(clip, CLIP_ERROR, "%s cannot be converted to %s", ddxvideo_layout_name(mp4->source.format),
                    ddxvideo_layout_name(clip->geometry.format));
    return CLIP_OK;
}

static enum clip_result open_mp4(struct clip *clip, int fd, int format) {
    clip->mp4 = calloc(1, sizeof *clip->mp4);
    if (!clip->mp4) {
        close(fd);
        return fail(clip, CLIP_ERROR, "out of memory");
    }
    clip->mp4->fd = fd;
    clip->start = -1;
    int error = mp4_open(&clip->mp4->file, fd);
    if (error)
        return fail(clip, error == -EBADMSG ? CLIP_BAD : CLIP_ERROR, "%s",
                    error == -EBADMSG ? "an MP4 file, but not one of ddxvideosave; " MAKE_ONE : strerror(-error));
    enum clip_result result = open_decoder(clip);
    return result == CLIP_OK ? look_at_first(clip, format) : result;
}

/* Planes of the decoded picture into planes without padding. False if it failed. */
static bool copy_out(struct clip *clip, unsigned char *const plane[3]) {
    struct clip_mp4 *mp4 = clip->mp4;
    const struct video_layout *layout = video_layout_of(clip->geometry.format);
    const unsigned char *from[3] = {mp4->frame->data[0], mp4->frame->data[1], mp4->frame->data[2]};
    int stride[3], rows[3];

    for (int i = 0; i < 3; i++)
        video_layout_plane(layout, clip->geometry.width, clip->geometry.height, i, &stride[i], &rows[i]);
    if (mp4->converter)
        return picture_convert(mp4->converter, from, mp4->frame->linesize, plane, stride);
    for (int i = 0; i < 3; i++)
        for (int row = 0; row < rows[i]; row++)
            memcpy(plane[i] + (size_t)row * (size_t)stride[i], from[i] + (ptrdiff_t)row * mp4->frame->linesize[i],
                   (size_t)stride[i]);
    return true;
}

/* The file's times are whole us; a frame's stamp has the ns, as long as its clock did not jump. */
static int64_t exact_time(const struct clip *clip, uint64_t file_time, int64_t capture) {
    int64_t since;

    if (clip->start >= 0 && !__builtin_sub_overflow(capture, clip->start, &since) && since >= 0 &&
        (uint64_t)since / 1000 == file_time)
        return since;
    return file_time < (uint64_t)Y4M_TIME_MAX / 1000 ? (int64_t)file_time * 1000 : Y4M_TIME_MAX;
}

static enum clip_result read_mp4(struct clip *clip, unsigned char *const plane[3], int64_t *time) {
    struct clip_mp4 *mp4 = clip->mp4;
    struct mp4_fragment fragment;
    struct stamp stamp;
    enum clip_result result = take_packet(clip, &fragment);

    if (result != CLIP_OK)
        return result;
    clip->frames++;
    bool stamped = stamp_read(mp4->packet->data, (size_t)mp4->packet->size, &stamp);
    *time = exact_time(clip, fragment.time, stamped ? stamp.time : -1);
    if (fragment.key && mp4->waits)
        avcodec_flush_buffers(mp4->codec);
    if ((mp4->waits && !fragment.key) || !stamped || !decode(mp4)) {
        mp4->waits = true;
        return fail(clip, CLIP_DAMAGED, "frame %lld cannot be decoded", (long long)clip->frames - 1);
    }
    mp4->waits = false;
    if (!copy_out(clip, plane))
        return fail(clip, CLIP_ERROR, "frame %lld cannot be converted to %s", (long long)clip->frames - 1,
                    ddxvideo_layout_name(clip->geometry.format));
    return CLIP_OK;
}

/* ---- Both ---- */

/* A descriptor of an MP4 file; -1: it is something else. A pipe must not be opened twice. */
static int open_if_mp4(const char *path) {
    struct stat status;

    if (!strcmp(path, "-") || stat(path, &status) || !S_ISREG(status.st_mode))
        return -1;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0 || mp4_is_any(fd))
        return fd;
    close(fd);
    return -1;
}

enum clip_result clip_open(struct clip *clip, const char *path, int format) {
    memset(clip, 0, sizeof *clip);
    clip->y4m.fd = -1;
    int fd = open_if_mp4(path);
    return fd < 0 ? of_y4m(clip, y4m_open(&clip->y4m, path, format)) : open_mp4(clip, fd, format);
}

void clip_close(struct clip *clip) {
    struct clip_mp4 *mp4 = clip->mp4;

    if (mp4) {
        picture_converter_free(mp4->converter);
        avcodec_free_context(&mp4->codec);
        av_packet_free(&mp4->packet);
        av_frame_free(&mp4->frame);
        close(mp4->fd);
        free(mp4);
    } else {
        y4m_close(&clip->y4m);
    }
    clip->mp4 = NULL;
}

enum clip_result clip_read(struct clip *clip, unsigned char *const plane[3], int64_t *time) {
    return clip->mp4 ? read_mp4(clip, plane, time) : of_y4m(clip, y4m_read(&clip->y4m, plane, time));
}

enum clip_result clip_rewind(struct clip *clip) {
    if (!clip->mp4)
        return of_y4m(clip, y4m_rewind(&clip->y4m));
    mp4_rewind(&clip->mp4->file);
    avcodec_flush_buffers(clip->mp4->codec);
    clip->frames = 0;
    clip->cut = clip->mp4->waits = false;
    return CLIP_OK;
}
