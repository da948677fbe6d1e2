/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Each layout from each kind of camera: samples by hand, odd sizes, and nothing written outside the planes. */
#include "check.h"
#include "convert.h"

#define GUARD 64
#define GUARD_BYTE 0x5a

struct result {
    struct ddxvideo_geometry geometry;
    unsigned char *memory[3], *plane[3];
    int stride[3], rows[3];
};

/* Planes without padding, as in the store, with guards around them. */
static struct result result_make(int format, int width, int height) {
    struct result result = {.geometry = {.width = width, .height = height, .format = format}};
    for (int i = 0; i < 3; i++) {
        video_layout_plane(video_layout_of(format), width, height, i, &result.stride[i], &result.rows[i]);
        size_t size = (size_t)result.stride[i] * (size_t)result.rows[i] + 2 * GUARD;
        result.memory[i] = malloc(size);
        CHECK(result.memory[i]);
        memset(result.memory[i], GUARD_BYTE, size);
        result.plane[i] = result.rows[i] ? result.memory[i] + GUARD : NULL;
    }
    return result;
}

static void result_free(struct result *result) {
    for (int i = 0; i < 3; i++) {
        const unsigned char *end = result->memory[i] + GUARD + (ptrdiff_t)result->stride[i] * result->rows[i];
        for (int k = 0; k < GUARD; k++)
            CHECK(result->memory[i][k] == GUARD_BYTE && end[k] == GUARD_BYTE);
        free(result->memory[i]);
    }
}

static size_t bytes(const struct pixels *pixels) {
    size_t offset[3];
    int stride[3];
    return pixels_planes(pixels, offset, stride);
}

static struct pixels picture(enum pixels_coding coding, int width, int height, int padding) {
    int row = coding == PIXELS_YUV411 ? width * 3 / 2 : width * pixels_find(coding)->row_bytes;
    return (struct pixels){.coding = coding, .width = width, .height = height, .stride = row + padding, .depth = 16};
}

/* The camera's bytes, at the end of their buffer, so that a sanitizer sees a read beyond them. */
static unsigned char *noise(const struct pixels *pixels) {
    unsigned char *data = malloc(bytes(pixels));
    CHECK(data);
    for (size_t i = 0; i < bytes(pixels); i++)
        data[i] = (unsigned char)(rand() >> 7);
    return data;
}

static void convert(struct result *result, const struct pixels *from, int range, const unsigned char *data,
                    bool stack) {
    struct converter converter;
    CHECK_EQUAL(converter_open(&converter, from, range, &result->geometry, stack), 0);
    CHECK_EQUAL(converter_run(&converter, data, bytes(from) - 1, result->plane, result->stride), -74); /* cut off */
    for (int again = 0; again < 2; again++)
        CHECK_EQUAL(converter_run(&converter, data, bytes(from), result->plane, result->stride), 0);
    converter_close(&converter);
}

/* ---- Without conversion: each sample is the camera's ---- */

/* The bytes of a sample in the camera's buffer, by hand: -1 is a zero byte, -2 is chroma of no colour. */
struct place {
    enum pixels_coding coding;
    int format;
    /* for each plane: bytes from sample to sample, offset of each byte in a sample */
    struct {
        int step, at[3];
    } plane[3];
};

static unsigned byte_of(const struct pixels *pixels, const unsigned char *data, const struct place *place, int plane,
                        int row, int x, int byte) {
    int at = place->plane[plane].at[byte];
    if (at < 0)
        return at == -2 ? 128 : 0;
    return data[row * pixels->stride + x * place->plane[plane].step + at];
}

static void test_place(const struct place *place, int width, int height) {
    const struct video_layout *layout = video_layout_of(place->format);
    struct pixels from = picture(place->coding, width, height, 6);
    struct result result = result_make(place->format, width, height);
    unsigned char *data = noise(&from);
    int size = layout->bytes * layout->samples;
    convert(&result, &from, DDX_VIDEO_RANGE_FULL, data, false);
    for (int i = 0; i < 3; i++)
        for (int k = 0, each = i ? 1 : size; k < result.stride[i] * result.rows[i]; k++)
            CHECK_EQUAL(result.plane[i][k],
                        byte_of(&from, data, place, i, k / result.stride[i], k % result.stride[i] / each, k % each));
    free(data);
    result_free(&result);
}

static void test_copies(void) {
    static const struct place places[] = {
        {PIXELS_YUYV, DDX_VIDEO_YUV422P, {{2, {0}}, {4, {1}}, {4, {3}}}},
        {PIXELS_UYVY, DDX_VIDEO_YUV422P, {{2, {1}}, {4, {0}}, {4, {2}}}},
        {PIXELS_GREY, DDX_VIDEO_YUV422P, {{1, {0}}, {0, {-2}}, {0, {-2}}}},
        {PIXELS_YUV444, DDX_VIDEO_YUV444P, {{3, {1}}, {3, {0}}, {3, {2}}}},
        {PIXELS_GREY, DDX_VIDEO_YUV444P, {{1, {0}}, {0, {-2}}, {0, {-2}}}},
        {PIXELS_GREY, DDX_VIDEO_GREY8, {{1, {0}}}},
        {PIXELS_YU12, DDX_VIDEO_GREY8, {{1, {0}}}},
        {PIXELS_NV12, DDX_VIDEO_GREY8, {{1, {0}}}},
        {PIXELS_YUYV, DDX_VIDEO_GREY8, {{2, {0}}}},
        {PIXELS_UYVY, DDX_VIDEO_GREY8, {{2, {1}}}},
        {PIXELS_YUV444, DDX_VIDEO_GREY8, {{3, {1}}}},
        {PIXELS_Y16, DDX_VIDEO_GREY8, {{2, {1}}}},
        {PIXELS_GREY16, DDX_VIDEO_GREY8, {{2, {0}}}},
        {PIXELS_Y16, DDX_VIDEO_GREY16, {{2, {0, 1}}}},
        {PIXELS_GREY16, DDX_VIDEO_GREY16, {{2, {1, 0}}}},
        {PIXELS_GREY, DDX_VIDEO_GREY16, {{1, {-1, 0}}}},
        {PIXELS_YU12, DDX_VIDEO_GREY16, {{1, {-1, 0}}}},
        {PIXELS_YUYV, DDX_VIDEO_GREY16, {{2, {-1, 0}}}},
        {PIXELS_UYVY, DDX_VIDEO_GREY16, {{2, {-1, 1}}}},
        {PIXELS_RGB24, DDX_VIDEO_RGB24, {{3, {0, 1, 2}}}},
        {PIXELS_GREY, DDX_VIDEO_RGB24, {{1, {0, 0, 0}}}},
    };
    for (size_t i = 0; i < sizeof(places) / sizeof(*places); i++) {
        bool whole = places[i].format == DDX_VIDEO_YUV422P || pixels_find(places[i].coding)->chroma_row_step == 2;
        test_place(&places[i], 38, 12);
        if (!whole)
            test_place(&places[i], 35, 11);
    }
}

static void test_depth(void) {
    static const struct {
        int depth;
        unsigned char high, low;
        unsigned wanted;
    } samples[] = {{16, 0xab, 0xcd, 0xabcd}, {12, 0x0a, 0xbc, 0xabc0}, {12, 0x1a, 0xbc, 0xfff0}, {8, 0, 0xcd, 0xcd00}};
    for (size_t i = 0; i < sizeof(samples) / sizeof(*samples); i++) {
        struct pixels from = picture(PIXELS_GREY16, 2, 2, 0);
        struct result result = result_make(DDX_VIDEO_GREY16, 2, 2);
        unsigned char data[8];
        from.depth = samples[i].depth;
        for (int k = 0; k < 8; k++)
            data[k] = k % 2 ? samples[i].low : samples[i].high;
        convert(&result, &from, DDX_VIDEO_RANGE_FULL, data, false);
        for (int k = 0; k < 8; k++)
            CHECK_EQUAL(result.plane[0][k], samples[i].wanted >> (k % 2 ? 8 : 0) & 0xff);
        result_free(&result);
    }
}

/* ---- Conversion and scaling: a uniform colour is kept in each size ---- */

static void fill(unsigned char *data, const struct pixels *from, int y, int u, int v) {
    size_t chroma = (size_t)from->stride * (size_t)from->height;
    for (size_t i = 0; i < bytes(from); i++) {
        int value = y;
        switch (from->coding) {
        case PIXELS_YUYV: value = i % 2 == 0 ? y : i % 4 == 1 ? u : v; break;
        case PIXELS_UYVY: value = i % 2 ? y : i % 4 ? v : u; break;
        case PIXELS_YU12: value = i < chroma ? y : i < chroma / 4 * 5 ? u : v; break;
        case PIXELS_NV12: value = i < chroma ? y : i % 2 == chroma % 2 ? u : v; break;
        case PIXELS_YUV444: value = (int[]){u, y, v}[i % 3]; break;
        case PIXELS_YUV411: value = (int[]){u, y, y, v, y, y}[i % 6]; break;
        default: break;
        }
        data[i] = (unsigned char)value;
    }
}

static bool near(int ours, int wanted) {
    return ours >= wanted - 2 && ours <= wanted + 2;
}

static void check_colour(const struct result *result, const int wanted[3]) {
    const struct video_layout *layout = video_layout_of(result->geometry.format);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < result->stride[i] * result->rows[i]; k++)
            if (layout->samples == 3)
                CHECK(near(result->plane[i][k], wanted[k % 3]));
            else if (layout->bytes == 1 || k % 2) /* of 16 bits the upper byte */
                CHECK(near(result->plane[i][k], wanted[i]));
}

/* YUV (120, 90, 170) is this in RGB by BT.601, by its definition. */
static const int colour[3] = {120, 90, 170}, limited[3] = {188, 101, 44}, full[3] = {179, 103, 53};

static void test_colour(enum pixels_coding coding, int range, int format, int width, int height, int scaled) {
    const bool grey = coding == PIXELS_GREY || coding == PIXELS_GREY16 || coding == PIXELS_Y16;
    const bool rgb = coding == PIXELS_RGB24 || coding >= PIXELS_RGB48;
    const int bright = range == DDX_VIDEO_RANGE_FULL ? 120 : 121; /* (120 - 16) * 255 / 219 */
    struct pixels from = picture(coding, width, height, 0);
    struct result result = result_make(format, width - scaled, height - scaled);
    unsigned char *data = malloc(bytes(&from));
    CHECK(data);
    fill(data, &from, 120, 90, 170);
    convert(&result, &from, range, data, false);
    /* grey of RGB and Bayer: 120 is 16 + 120 * 219 / 255 in the limited range */
    const int greyish[] = {bright, bright, bright}, of_rgb[] = {119, 128, 128}, of_grey[] = {120, 128, 128};
    if (format == DDX_VIDEO_RGB24)
        check_colour(&result, rgb                             ? (const int[]){120, 120, 120}
                              : grey                          ? greyish
                              : range == DDX_VIDEO_RANGE_FULL ? full
                                                              : limited);
    else
        check_colour(&result, rgb ? of_rgb : grey ? of_grey : colour);
    free(data);
    result_free(&result);
}

static void test_colours(void) {
    static const enum pixels_coding codings[] = {
        PIXELS_YU12,   PIXELS_NV12,   PIXELS_YUYV,   PIXELS_UYVY,  PIXELS_GREY, PIXELS_Y16,   PIXELS_RGB24,
        PIXELS_GREY16, PIXELS_YUV411, PIXELS_YUV444, PIXELS_RGB48, PIXELS_RGGB, PIXELS_BGGR16};
    for (int format = DDX_VIDEO_YUV422P; format <= DDX_VIDEO_RGB24; format++)
        for (size_t i = 0; i < sizeof(codings) / sizeof(*codings); i++)
            for (int scaled = 0; scaled <= 10; scaled += format == DDX_VIDEO_YUV422P ? 2 : 1)
                for (int range = DDX_VIDEO_RANGE_LIMITED; range <= DDX_VIDEO_RANGE_FULL; range++) {
                    test_colour(codings[i], range, format, 116, 24, scaled);
                    test_colour(codings[i], range, format, 44, 20, scaled);
                }
}

/* ---- Fields ---- */

/* A picture whose top field is 10 and whose bottom field is 100. */
static void test_fields(enum pixels_coding coding, int format, enum pixels_order order, bool stack, bool scaled) {
    struct pixels from = picture(coding, 64, 32, 0);
    struct result result = result_make(format, scaled ? 48 : 64, scaled ? 24 : 32);
    unsigned char *data = malloc(bytes(&from));
    CHECK(data);
    from.order = order;
    for (int row = 0; row < 32; row++) {
        bool bottom = order == PIXELS_INTERLEAVED ? row % 2 : (row >= 16) != (order == PIXELS_BOTTOM_TOP);
        memset(data + row * from.stride, bottom ? 100 : 10, (size_t)from.stride);
    }
    convert(&result, &from, DDX_VIDEO_RANGE_FULL, data, stack);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < result.stride[i] * result.rows[i]; k++) {
            int row = k / result.stride[i];
            bool bottom = stack ? row >= result.rows[i] / 2 : row % 2;
            CHECK(near(result.plane[i][k], bottom ? 100 : 10));
        }
    free(data);
    result_free(&result);
}

static void test_all_fields(void) {
    static const struct {
        enum pixels_coding coding;
        int format;
    } kinds[] = {{PIXELS_YUYV, DDX_VIDEO_YUV422P}, {PIXELS_UYVY, DDX_VIDEO_YUV422P}, {PIXELS_GREY, DDX_VIDEO_GREY8},
                 {PIXELS_YUYV, DDX_VIDEO_GREY8},   {PIXELS_Y16, DDX_VIDEO_GREY16},   {PIXELS_RGB24, DDX_VIDEO_RGB24},
                 {PIXELS_YUYV, DDX_VIDEO_YUV444P}};
    for (size_t i = 0; i < sizeof(kinds) / sizeof(*kinds); i++)
        for (int order = PIXELS_INTERLEAVED; order <= PIXELS_BOTTOM_TOP; order++)
            for (int how = 0; how < 4; how++)
                test_fields(kinds[i].coding, kinds[i].format, (enum pixels_order)order, how & 1, how & 2);
}

int main(void) {
    test_copies();
    test_depth();
    test_colours();
    test_all_fields();
    return 0;
}
