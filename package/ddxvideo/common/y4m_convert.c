/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Every chroma layout that is not 8-bit 4:2:0, converted to it. libswscale does it, but for mono (see below). */
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
#include <stdlib.h>
#include <string.h>

#include "y4m.h"

#define VECTOR 64 /* bytes, the largest that any processor has */

struct y4m_converter {
    struct y4m_header header;
    struct SwsContext *scaler; /* NULL for mono */
    int fields;                /* 2: each field by itself, so that interlaced chroma is not mixed between fields */
    unsigned char *target[3];  /* libswscale writes rows in whole vectors, beyond their end: not for the store */
    int target_stride[3];
};

static enum AVPixelFormat pixel_format(const struct y4m_layout *layout) {
    static const char *const chroma[3][3] = {{"444", NULL, NULL}, {"422", "420", NULL}, {"411", NULL, "410"}};
    char name[32];
    const char *subsampling = chroma[layout->chroma_x][layout->chroma_y];

    if (!subsampling)
        return AV_PIX_FMT_NONE;
    if (layout->bits == 8)
        snprintf(name, sizeof name, "yuv%sp", subsampling);
    else
        snprintf(name, sizeof name, "yuv%sp%dle", subsampling, layout->bits);
    return av_get_pix_fmt(name);
}

/* Positions in 1/256 luma samples. Chroma on the left column is 0; amid two samples 128. */
static int column_position(const struct y4m_header *header) {
    return header->geometry.format == DDX_VIDEO_420_JPEG ? (128 << header->layout->chroma_x) - 128 : 0;
}

static bool set_up_scaler(struct y4m_converter *converter) {
    const struct y4m_header *header = &converter->header;
    struct SwsContext *scaler = converter->scaler = sws_alloc_context();
    enum AVPixelFormat from = pixel_format(header->layout);

    if (!scaler || from == AV_PIX_FMT_NONE)
        return false;
    const struct {
        const char *name;
        int64_t value;
    } settings[] = {
        {"srcw", header->geometry.width},
        {"srch", header->geometry.height / converter->fields},
        {"src_format", from},
        {"src_range", 0}, /* the same on both sides: the numbers stay what they are */
        {"dstw", header->geometry.width},
        {"dsth", header->geometry.height / converter->fields},
        {"dst_format", AV_PIX_FMT_YUV420P},
        {"dst_range", 0},
        {"src_h_chr_pos", column_position(header)},
        {"dst_h_chr_pos", header->geometry.format == DDX_VIDEO_420_JPEG ? 128 : 0},
        {"sws_flags", SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP | SWS_BITEXACT},
    };
    for (size_t i = 0; i < sizeof settings / sizeof *settings; i++)
        if (av_opt_set_int(scaler, settings[i].name, settings[i].value, 0) < 0)
            return false;
    return sws_init_context(scaler, NULL, NULL) >= 0;
}

static bool set_up_target(struct y4m_converter *converter) {
    for (int i = 0; i < 3; i++) {
        int width = converter->header.geometry.width >> (i > 0), rows = converter->header.geometry.height >> (i > 0);
        int stride = converter->target_stride[i] = (width + 2 * VECTOR - 1) / VECTOR * VECTOR;

        converter->target[i] = aligned_alloc(VECTOR, (size_t)stride * (size_t)rows);
        if (!converter->target[i])
            return false;
    }
    return true;
}

struct y4m_converter *y4m_converter_new(const struct y4m_header *header) {
    struct y4m_converter *converter = calloc(1, sizeof *converter);

    if (!converter)
        return NULL;
    converter->header = *header;
    int interlacing = header->geometry.interlacing;
    bool fields = (interlacing == 't' || interlacing == 'b') && header->layout->chroma_y == 0;
    converter->fields = fields && header->geometry.height % 4 == 0 ? 2 : 1;
    if (header->layout->chroma_x >= 0 && !(set_up_scaler(converter) && set_up_target(converter))) {
        y4m_converter_free(converter);
        return NULL;
    }
    return converter;
}

void y4m_converter_free(struct y4m_converter *converter) {
    if (!converter)
        return;
    sws_freeContext(converter->scaler);
    for (int i = 0; i < 3; i++)
        free(converter->target[i]);
    free(converter);
}

/* Y4M's mono is the luma plane of a YUV picture; libswscale would take it for full-range grey and change it. */
static void convert_mono(const struct y4m_header *header, const unsigned char *source, unsigned char *const plane[3]) {
    size_t samples = (size_t)header->geometry.width * (size_t)header->geometry.height;
    int bits = header->layout->bits, shift = bits - 8;

    if (bits == 8) {
        memcpy(plane[0], source, samples);
    } else {
        for (size_t i = 0; i < samples; i++) {
            unsigned value = source[2 * i] | (unsigned)source[2 * i + 1] << 8;

            value = (value + (1u << (shift - 1))) >> shift;
            plane[0][i] = (unsigned char)(value > 255 ? 255 : value);
        }
    }
    memset(plane[1], 128, samples / 4);
    memset(plane[2], 128, samples / 4);
}

bool y4m_convert(struct y4m_converter *converter, const unsigned char *source, unsigned char *const plane[3]) {
    const struct y4m_header *header = &converter->header;

    if (!converter->scaler) {
        convert_mono(header, source, plane);
        return true;
    }
    int sample = header->layout->bits > 8 ? 2 : 1, width = header->geometry.width;
    int chroma_width = (width + (1 << header->layout->chroma_x) - 1) >> header->layout->chroma_x;
    int rows = header->geometry.height / converter->fields;
    const unsigned char *planes[3] = {source};
    planes[1] = planes[0] + y4m_plane_bytes(header, 0);
    planes[2] = planes[1] + y4m_plane_bytes(header, 1);
    const int source_stride[3] = {width * sample, chroma_width * sample, chroma_width * sample};

    for (int field = 0; field < converter->fields; field++) {
        const uint8_t *from[4] = {0};
        uint8_t *to[4] = {0};
        int from_stride[4] = {0}, to_stride[4] = {0};

        for (int i = 0; i < 3; i++) {
            from[i] = planes[i] + field * source_stride[i];
            to[i] = converter->target[i] + field * converter->target_stride[i];
            from_stride[i] = source_stride[i] * converter->fields;
            to_stride[i] = converter->target_stride[i] * converter->fields;
        }
        if (sws_scale(converter->scaler, from, from_stride, 0, rows, to, to_stride) != rows)
            return false;
    }
    for (int i = 0; i < 3; i++) {
        size_t bytes = (size_t)(width >> (i > 0));

        for (int row = 0; row < header->geometry.height >> (i > 0); row++)
            memcpy(plane[i] + (size_t)row * bytes,
                   converter->target[i] + (size_t)row * (size_t)converter->target_stride[i], bytes);
    }
    return true;
}
