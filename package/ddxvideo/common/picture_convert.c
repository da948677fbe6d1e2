/* SPDX-License-Identifier: GPL-2.0-or-later */
/* libswscale converts everything except grey, which it would treat as full-range and change. */
#include "picture_convert.h"

#include <errno.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
#include <stdlib.h>
#include <string.h>

#include "video_layout.h"

#define VECTOR 64 /* bytes of the largest vector of any processor */

struct picture_converter {
    struct picture_kind from;
    struct ddxvideo_geometry to;
    const struct video_layout *layout; /* of `to` */
    struct SwsContext *scaler;         /* NULL: luma is copied, and one side has no chroma */
    int fields;                        /* 2: each field separately, so that interlaced chroma is not mixed */
    unsigned char *target[3];          /* libswscale writes whole vectors, beyond the end of rows: not into the store */
    int target_stride[3];
};

struct picture_kind picture_kind_of(const struct ddxvideo_geometry *geometry) {
    const struct video_layout *layout = video_layout_of(geometry->format);

    return (struct picture_kind){.bits = 8 * layout->bytes,
                                 .chroma_x = layout->chroma_x,
                                 .chroma_y = layout->chroma_y,
                                 .rgb = layout->samples == 3,
                                 .full = geometry->range == DDX_VIDEO_RANGE_FULL,
                                 .centred = geometry->format == DDX_VIDEO_420_JPEG};
}

static bool is_grey(const struct picture_kind *kind) {
    return kind->chroma_x < 0 && !kind->rgb;
}

static enum AVPixelFormat pixel_format(const struct picture_kind *kind) {
    static const char *const chroma[3][3] = {{"444", NULL, NULL}, {"422", "420", NULL}, {"411", NULL, "410"}};
    char name[32];

    if (kind->rgb)
        return AV_PIX_FMT_RGB24;
    const char *subsampling = chroma[kind->chroma_x][kind->chroma_y];
    if (!subsampling)
        return AV_PIX_FMT_NONE;
    if (kind->bits == 8)
        snprintf(name, sizeof name, "yuv%sp", subsampling);
    else
        snprintf(name, sizeof name, "yuv%sp%dle", subsampling, kind->bits);
    return av_get_pix_fmt(name);
}

/* In 1/256 luma samples: chroma on the left column is 0, amid two columns 128. */
static int column_position(const struct picture_kind *kind) {
    return kind->centred && kind->chroma_x > 0 ? (128 << kind->chroma_x) - 128 : 0;
}

static bool set_up_scaler(struct picture_converter *converter) {
    struct SwsContext *scaler = converter->scaler = sws_alloc_context();
    const struct picture_kind *from = &converter->from, to = picture_kind_of(&converter->to);
    enum AVPixelFormat source = pixel_format(from);
    bool colours = from->rgb || to.rgb; /* otherwise both sides have the same range, and values do not change */

    if (!scaler || source == AV_PIX_FMT_NONE)
        return false;
    const struct {
        const char *name;
        int64_t value;
    } settings[] = {
        {"srcw", converter->to.width},
        {"srch", converter->to.height / converter->fields},
        {"src_format", source},
        {"src_range", colours && from->full},
        {"dstw", converter->to.width},
        {"dsth", converter->to.height / converter->fields},
        {"dst_format", pixel_format(&to)},
        {"dst_range", colours && to.full},
        {"src_h_chr_pos", column_position(from)},
        {"dst_h_chr_pos", column_position(&to)},
        {"sws_flags",
         SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP | SWS_BITEXACT | (to.rgb ? SWS_FULL_CHR_H_INT : 0)},
    };
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++)
        if (av_opt_set_int(scaler, settings[i].name, settings[i].value, 0) < 0)
            return false;
    return sws_init_context(scaler, NULL, NULL) >= 0;
}

static bool set_up_target(struct picture_converter *converter) {
    for (int i = 0; i < 3; i++) {
        int bytes, rows;

        video_layout_plane(converter->layout, converter->to.width, converter->to.height, i, &bytes, &rows);
        int stride = converter->target_stride[i] = (bytes + 2 * VECTOR - 1) / VECTOR * VECTOR;
        if (!rows)
            continue;
        converter->target[i] = aligned_alloc(VECTOR, (size_t)stride * (size_t)rows);
        if (!converter->target[i])
            return false;
    }
    return true;
}

/* Whether interlaced fields have separate chroma rows on one side only. */
static bool separates_fields(const struct picture_kind *from, const struct ddxvideo_geometry *to) {
    int rows = video_layout_of(to->format)->chroma_y > 0, source_rows = from->chroma_y;

    return (to->interlacing == 't' || to->interlacing == 'b') && to->height % 4 == 0 && source_rows < 2 &&
           rows != (source_rows > 0);
}

struct picture_converter *picture_converter_new(const struct picture_kind *from, const struct ddxvideo_geometry *to) {
    const struct video_layout *layout = video_layout_of(to->format);
    struct picture_converter *converter = calloc(1, sizeof *converter);
    bool to_grey = layout->chroma_x < 0 && layout->samples == 1;

    if (!converter)
        return NULL;
    converter->from = *from;
    converter->to = *to;
    converter->layout = layout;
    converter->fields = separates_fields(from, to) ? 2 : 1;
    if ((to_grey && from->rgb) ||
        (!to_grey && !is_grey(from) && !(set_up_scaler(converter) && set_up_target(converter)))) {
        picture_converter_free(converter);
        return NULL;
    }
    return converter;
}

void picture_converter_free(struct picture_converter *converter) {
    if (!converter)
        return;
    sws_freeContext(converter->scaler);
    for (int i = 0; i < 3; i++)
        free(converter->target[i]);
    free(converter);
}

/* ---- Grey ---- */

/* A sample of a row, in `bits` bits. */
static unsigned sample_at(const unsigned char *row, int x, int from_bits, int bits) {
    unsigned value = from_bits > 8 ? row[2 * x] | (unsigned)row[2 * x + 1] << 8 : row[x];

    if (from_bits <= bits)
        value <<= bits - from_bits;
    else
        value = (value + (1u << (from_bits - bits - 1))) >> (from_bits - bits);
    return value >= 1u << bits ? (1u << bits) - 1 : value;
}

static void copy_luma(const struct picture_converter *converter, const unsigned char *from, unsigned char *to) {
    int bits = converter->from.bits, width = converter->to.width;

    if (bits == 8 * converter->layout->bytes) {
        memcpy(to, from, (size_t)width * (size_t)converter->layout->bytes);
        return;
    }
    for (int x = 0; x < width; x++) {
        unsigned value = sample_at(from, x, bits, 8 * converter->layout->bytes);

        if (converter->layout->bytes == 2) {
            to[2 * x] = (unsigned char)value;
            to[2 * x + 1] = (unsigned char)(value >> 8);
        } else {
            to[x] = (unsigned char)value;
        }
    }
}

/* Black is 0 in RGB. */
static void copy_to_rgb(const struct picture_converter *converter, const unsigned char *from, unsigned char *to) {
    for (int x = 0; x < converter->to.width; x++) {
        int value = (int)sample_at(from, x, converter->from.bits, 8);

        if (!converter->from.full)
            value = ((value - 16) * 255 + 109) / 219;
        memset(to + 3 * x, value < 0 ? 0 : value > 255 ? 255 : value, 3);
    }
}

static void convert_grey(const struct picture_converter *converter, const unsigned char *from, int from_stride,
                         unsigned char *const to[3], const int to_stride[3]) {
    for (int row = 0; row < converter->to.height; row++) {
        const unsigned char *source = from + (ptrdiff_t)row * from_stride;
        unsigned char *target = to[0] + (ptrdiff_t)row * to_stride[0];

        if (converter->layout->samples == 3)
            copy_to_rgb(converter, source, target);
        else
            copy_luma(converter, source, target);
    }
    for (int plane = 1; plane < 3; plane++) {
        int bytes, rows;

        video_layout_plane(converter->layout, converter->to.width, converter->to.height, plane, &bytes, &rows);
        for (int row = 0; row < rows; row++)
            memset(to[plane] + (ptrdiff_t)row * to_stride[plane], 128, (size_t)bytes);
    }
}

/* ---- Colours ---- */

static bool scale(struct picture_converter *converter, const unsigned char *const from[3], const int from_stride[3]) {
    int rows = converter->to.height / converter->fields;

    for (int field = 0; field < converter->fields; field++) {
        const uint8_t *source[4] = {0};
        uint8_t *target[4] = {0};
        int source_stride[4] = {0}, target_stride[4] = {0};

        for (int i = 0; i < 3; i++) {
            source[i] = from[i] ? from[i] + (ptrdiff_t)field * from_stride[i] : NULL;
            source_stride[i] = from_stride[i] * converter->fields;
            if (converter->target[i])
                target[i] = converter->target[i] + (ptrdiff_t)field * converter->target_stride[i];
            target_stride[i] = converter->target_stride[i] * converter->fields;
        }
        if (sws_scale(converter->scaler, source, source_stride, 0, rows, target, target_stride) != rows)
            return false;
    }
    return true;
}

bool picture_convert(struct picture_converter *converter, const unsigned char *const from[3], const int from_stride[3],
                     unsigned char *const to[3], const int to_stride[3]) {
    if (!converter->scaler) {
        convert_grey(converter, from[0], from_stride[0], to, to_stride);
        return true;
    }
    if (!scale(converter, from, from_stride))
        return false;
    for (int i = 0; i < 3; i++) {
        int bytes, rows;

        video_layout_plane(converter->layout, converter->to.width, converter->to.height, i, &bytes, &rows);
        for (int row = 0; row < rows; row++)
            memcpy(to[i] + (ptrdiff_t)row * to_stride[i],
                   converter->target[i] + (ptrdiff_t)row * converter->target_stride[i], (size_t)bytes);
    }
    return true;
}

struct ddxvideo_geometry as_420_geometry(const struct ddxvideo_geometry *from) {
    struct ddxvideo_geometry to = *from;

    if (video_layout_is_420(from->format))
        return to;
    to.format = DDX_VIDEO_420_MPEG2;
    to.width &= ~1;
    to.height &= ~1;
    if (to.height % (2 * to.fields))
        to.fields = 1;
    if (from->format == DDX_VIDEO_RGB24)
        to.range = DDX_VIDEO_RANGE_LIMITED;
    return to;
}

/* Makes a converter for pictures of this geometry, and memory for its result. */
static int set_up(struct as_420 *as, const struct ddxvideo_geometry *from) {
    const struct picture_kind kind = picture_kind_of(from);
    struct ddxvideo_picture *to = &as->picture;

    as_420_close(as);
    to->geometry = as_420_geometry(from);
    if (!to->geometry.width || !to->geometry.height)
        return -ERANGE;
    as->converter = picture_converter_new(&kind, &to->geometry);
    as->memory = malloc(video_layout_bytes(&to->geometry));
    if (!as->converter || !as->memory) {
        as_420_close(as);
        return -ENOMEM;
    }
    video_layout_place(to, as->memory);
    as->from = *from;
    return 0;
}

int as_420(struct as_420 *as, const struct ddxvideo_picture *picture, const struct ddxvideo_picture **result) {
    unsigned char *plane[3];

    *result = picture;
    if (video_layout_is_420(picture->geometry.format))
        return 0;
    int error =
        as->converter && ddxvideo_same_layout(&as->from, &picture->geometry) ? 0 : set_up(as, &picture->geometry);
    if (error)
        return error;
    for (int i = 0; i < 3; i++)
        plane[i] = as->memory + (as->picture.plane[i] - as->memory);
    as->picture.geometry = as_420_geometry(&picture->geometry);
    as->picture.stamp = picture->stamp;
    *result = &as->picture;
    return picture_convert(as->converter, picture->plane, picture->stride, plane, as->picture.stride) ? 0 : -ENOMEM;
}

const char *as_420_error(int error) {
    switch (error) {
    case -ERANGE: return "it is smaller than 2x2";
    case -EBADMSG: return "its numbers do not fit its memory";
    default: return ddx_error_text(error);
    }
}

void as_420_close(struct as_420 *as) {
    picture_converter_free(as->converter);
    free(as->memory);
    *as = (struct as_420){.converter = NULL};
}
