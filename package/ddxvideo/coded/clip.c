/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "clip.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "h264_decode.h"
#include "mp4_read.h"
#include "picture_convert.h"
#include "video_layout.h"

struct clip_mp4 {
    int fd;
    struct mp4_file file;
    struct h264_decoder decoder;
    struct picture_converter *converter; /* NULL: the planes are copied */
};

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

/* ---- MP4 ---- */

/* The next frame's bytes, for the decoder. */
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
    uint8_t *room = h264_decoder_room(&mp4->decoder, fragment->bytes);
    if (!room)
        return fail(clip, CLIP_ERROR, "frame %lld: no memory for %u bytes", number, fragment->bytes);
    int error = mp4_read_bytes(&mp4->file, fragment, room);
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
    if (!h264_decoder_look(&mp4->decoder, &mp4->file.format, &stamp))
        return fail(clip, CLIP_BAD, "its first frame does not tell the layout of the pictures; the file is damaged");
    clip->geometry = mp4->decoder.geometry;
    clip->geometry.format = choose_format(stamp.geometry.format, format);
    if (clip->geometry.format == DDX_VIDEO_RGB24) /* has no other range */
        clip->geometry.range = DDX_VIDEO_RANGE_FULL;
    clip->start = stamp.time > 0 ? stamp.time : -1;
    mp4_rewind(&mp4->file);
    if (clip->geometry.format == stamp.geometry.format)
        return CLIP_OK;
    const struct picture_kind kind = picture_kind_of(&stamp.geometry);
    mp4->converter = picture_converter_new(&kind, &clip->geometry);
    if (!mp4->converter)
        return fail(clip, CLIP_ERROR, "%s cannot be converted to %s", ddxvideo_layout_name(stamp.geometry.format),
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
                    error == -EBADMSG ? MP4_FOREIGN : strerror(-error));
    error = h264_decoder_open(&clip->mp4->decoder, &clip->mp4->file.format, 1);
    if (error)
        return fail(clip, error == -EBADMSG ? CLIP_BAD : CLIP_ERROR, "%s", h264_decoder_error(error));
    return look_at_first(clip, format);
}

/* The decoded picture into planes without padding. False if it failed. */
static bool copy_out(struct clip *clip, unsigned char *const plane[3]) {
    const struct video_layout *layout = video_layout_of(clip->geometry.format);
    const AVFrame *frame = clip->mp4->decoder.frame;
    const unsigned char *from[3] = {frame->data[0], frame->data[1], frame->data[2]};
    int stride[3], rows[3];

    if (!clip->mp4->converter) {
        h264_decoder_copy(&clip->mp4->decoder, plane);
        return true;
    }
    for (int i = 0; i < 3; i++)
        video_layout_plane(layout, clip->geometry.width, clip->geometry.height, i, &stride[i], &rows[i]);
    return picture_convert(clip->mp4->converter, from, frame->linesize, plane, stride);
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
    bool decoded = h264_decode(&mp4->decoder, fragment.key, &stamp);
    *time = exact_time(clip, fragment.time, stamp.time);
    if (!decoded)
        return fail(clip, CLIP_DAMAGED, "frame %lld cannot be decoded", (long long)clip->frames - 1);
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
        h264_decoder_close(&mp4->decoder);
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
    h264_decoder_rewind(&clip->mp4->decoder);
    clip->frames = 0;
    clip->cut = false;
    return CLIP_OK;
}
