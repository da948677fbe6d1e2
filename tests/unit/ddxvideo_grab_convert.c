/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of every format and field order, compared with FFmpeg's program, with values computed by hand, and with
 * those of other processors. */
#include "../scratch.h"
#include "check.h"
#include "convert.h"
#include <libavutil/cpu.h>

#define GUARD 64
#define GUARD_BYTE 0x5a

static unsigned char *noise(size_t size) {
    unsigned char *data = malloc(size);
    CHECK(data);
    for (size_t i = 0; i < size; i++)
        data[i] = (unsigned char)(rand() >> 7);
    return data;
}

struct result {
    unsigned char *memory[3], *plane[3];
    int stride[3];
    size_t size[3];
};

/* Planes without padding, as in the store, with guards around them. */
static struct result result_make(int format, int width, int height) {
    struct result result;
    for (int i = 0; i < 3; i++) {
        int rows;
        video_layout_plane(video_layout_of(format), width, height, i, &result.stride[i], &rows);
        result.size[i] = (size_t)result.stride[i] * (size_t)rows;
        result.memory[i] = malloc(result.size[i] + 2 * GUARD);
        CHECK(result.memory[i]);
        memset(result.memory[i], GUARD_BYTE, result.size[i] + 2 * GUARD);
        result.plane[i] = result.memory[i] + GUARD;
    }
    return result;
}

static void result_free(struct result *result) {
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < GUARD; k++)
            CHECK(result->memory[i][k] == GUARD_BYTE && result->plane[i][result->size[i] + (size_t)k] == GUARD_BYTE);
        free(result->memory[i]);
    }
}

static size_t bytes(const struct pixels *pixels) {
    size_t offset[3];
    int stride[3];
    return pixels_planes(pixels, offset, stride);
}

static struct result convert_to(int format, const struct pixels *from, const void *data, int width, int height,
                                bool stack) {
    struct converter converter;
    struct result result = result_make(format, width, height);
    const struct ddxvideo_geometry geometry = {.width = width, .height = height, .format = format};
    CHECK_EQUAL(converter_open(&converter, from, 0, &geometry, stack), 0);
    CHECK_EQUAL(converter_run(&converter, data, bytes(from) - 1, result.plane, result.stride), -74); /* cut off */
    CHECK_EQUAL(converter_run(&converter, data, bytes(from), result.plane, result.stride), 0);
    converter_close(&converter);
    return result;
}

static struct result convert(const struct pixels *from, const void *data, int width, int height, bool stack) {
    return convert_to(DDX_VIDEO_420, from, data, width, height, stack);
}

/* FFmpeg's conversion of the same bytes, of raw ones through RGB; false if there is no such program. */
static bool ask_ffmpeg(const char *format, const void *data, size_t size, int width, int height, int to_width,
                       int to_height, const char *to, unsigned char *out, size_t out_size) {
    char command[512], *name = scratch_path("picture");
    FILE *file = fopen(name, "wb");
    CHECK(file && fwrite(data, 1, size, file) == size && !fclose(file));
    snprintf(command, sizeof(command),
             "ffmpeg -v error -nostdin -filter_threads 1 -f rawvideo -pix_fmt %s -s %dx%d -i %s "
             "-vf %sscale=%d:%d:flags=bilinear+accurate_rnd -pix_fmt %s -f rawvideo - 2>&1",
             format, width, height, name, strncmp(format, "bayer", 5) ? "" : "format=rgb24,", to_width, to_height, to);
    FILE *pipe = popen(command, "r");
    size_t got = pipe ? fread(out, 1, out_size, pipe) : 0;
    int status = pipe ? pclose(pipe) : -1;
    free(name);
    if (WEXITSTATUS(status) == 127)
        return false;
    CHECK_EQUAL(status, 0);
    CHECK_EQUAL(got, out_size);
    return true;
}

static bool test_against_ffmpeg(enum pixels_coding coding, const char *format, int to_width, int to_height) {
    const int width = 128, height = 96;
    struct pixels from = {
        .coding = coding, .width = width, .height = height, .stride = width * pixels_find(coding)->row_bytes};
    unsigned char *data = noise(bytes(&from));
    struct result result = convert(&from, data, to_width, to_height, false);
    size_t total = result.size[0] + 2 * result.size[1], at = 0;
    unsigned char *theirs = malloc(total);
    bool there =
        ask_ffmpeg(format, data, bytes(&from), width, height, to_width, to_height,
                   coding == PIXELS_GREY ? "gray" : "yuv420p", theirs, coding == PIXELS_GREY ? result.size[0] : total);
    for (int i = 0; there && i < (coding == PIXELS_GREY ? 1 : 3); at += result.size[i++])
        CHECK(!memcmp(result.plane[i], theirs + at, result.size[i]));
    if (there && coding != PIXELS_GREY) { /* the check itself */
        theirs[total - 1] ^= 1;
        CHECK(memcmp(result.plane[2], theirs + total - result.size[2], result.size[2]) != 0);
    }
    free(theirs);
    free(data);
    result_free(&result);
    return there;
}

/* Processors with other instructions make the same pictures. */
static void test_on_each_processor(enum pixels_coding coding, int format, int to_width, int to_height) {
    static const unsigned processors[] = {0, AV_CPU_FLAG_MMX, AV_CPU_FLAG_MMX | AV_CPU_FLAG_MMXEXT | AV_CPU_FLAG_SSE};
    struct pixels from = {.coding = coding, .width = 128, .height = 96, .depth = 16};
    from.stride = coding == PIXELS_YUV411 ? 128 * 3 / 2 : 128 * pixels_find(coding)->row_bytes;
    unsigned char *data = noise(bytes(&from));
    struct result ours = convert_to(format, &from, data, to_width, to_height, false);
    for (size_t i = 0; i < sizeof(processors) / sizeof(*processors); i++) {
        av_force_cpu_flags((int)(processors[i] & (unsigned)av_get_cpu_flags()));
        struct result theirs = convert_to(format, &from, data, to_width, to_height, false);
        av_force_cpu_flags(-1);
        for (int k = 0; k < 3; k++)
            CHECK(!memcmp(ours.plane[k], theirs.plane[k], ours.size[k]));
        result_free(&theirs);
    }
    free(data);
    result_free(&ours);
}

/* Bytes of packed 4:2:2 at (x, y), by hand; u: 1, v: 3 (YUYV). */
static void test_by_hand(void) {
    const int width = 36, height = 20, stride = 2 * width + 24; /* rows with padding */
    struct pixels from = {.coding = PIXELS_YUYV, .width = width, .height = height, .stride = stride};
    unsigned char *data = noise(bytes(&from));
    struct result result = convert(&from, data, width, height, false);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            CHECK_EQUAL(result.plane[0][y * width + x], data[y * stride + 2 * x]);
    for (int plane = 1; plane < 3; plane++)
        for (int y = 0; y < height / 2; y++)
            for (int x = 0; x < width / 2; x++) {
                const unsigned char *at = data + 2 * y * stride + 4 * x + (plane == 1 ? 1 : 3);
                int twice = at[0] + at[stride], ours = result.plane[plane][y * (width / 2) + x];
                CHECK(2 * ours >= twice - 1 && 2 * ours <= twice + 1);
            }
    result_free(&result);
    free(data);
}

/* A picture with bytes from 10 on in the top field and from 100 on in the bottom field, in any field order. */
static void fill_fields(unsigned char *data, const struct pixels *pixels) {
    size_t offset[3];
    int stride[3];
    pixels_planes(pixels, offset, stride);
    const struct pixels_format *format = pixels_find(pixels->coding);
    for (int i = 0; i < format->planes; i++) {
        int rows = i ? pixels->height / format->chroma_row_step : pixels->height;
        for (int row = 0; row < rows; row++) {
            bool bottom = pixels->order == PIXELS_INTERLEAVED ? row % 2 : (row >= rows / 2);
            if (pixels->order == PIXELS_BOTTOM_TOP)
                bottom = !bottom;
            memset(data + offset[i] + (ptrdiff_t)row * stride[i], bottom ? 100 : 10, (size_t)stride[i]);
        }
    }
}

static void test_fields(enum pixels_coding coding, enum pixels_order order, bool stack) {
    const int width = 64, height = 32;
    struct pixels from = {.coding = coding,
                          .width = width,
                          .height = height,
                          .order = order,
                          .stride = width * pixels_find(coding)->row_bytes};
    unsigned char *data = malloc(bytes(&from));
    fill_fields(data, &from);
    for (int scaled = 0; scaled < 2; scaled++) { /* scaling does not mix fields */
        int to_width = scaled ? 48 : width, to_height = scaled ? 24 : height;
        struct result result = convert(&from, data, to_width, to_height, stack);
        for (int i = 0; i < (coding == PIXELS_GREY ? 1 : 3); i++) {
            int rows = i ? to_height / 2 : to_height;
            for (int row = 0; row < rows; row++) {
                bool bottom = stack ? row >= rows / 2 : row % 2;
                for (int x = 0; x < result.stride[i]; x++)
                    CHECK_EQUAL(result.plane[i][row * result.stride[i] + x], bottom ? 100 : 10);
            }
        }
        result_free(&result);
    }
    free(data);
}

static void test_refusals(void) {
    struct converter converter;
    struct pixels from = {.coding = PIXELS_YUYV, .width = 32, .height = 32, .stride = 64};
    const struct ddxvideo_geometry square = {.width = 32, .height = 32}, low = {.width = 32, .height = 30};
    CHECK_EQUAL(converter_open(&converter, &from, 0, &square, true), -22); /* no fields to stack */
    from.order = PIXELS_INTERLEAVED;
    CHECK_EQUAL(converter_open(&converter, &from, 0, &low, true), -22);
    from.coding = PIXELS_NONE;
    CHECK_EQUAL(converter_open(&converter, &from, 0, &square, false), -22);
}

int main(void) {
    static const struct {
        enum pixels_coding coding;
        const char *name;
    } formats[] = {{PIXELS_YU12, "yuv420p"},
                   {PIXELS_NV12, "nv12"},
                   {PIXELS_YUYV, "yuyv422"},
                   {PIXELS_UYVY, "uyvy422"},
                   {PIXELS_GREY, "gray"}};
    static const struct {
        enum pixels_coding coding;
        const char *name;
    } progressive[] = {{PIXELS_RGB24, "rgb24"},
                       {PIXELS_RGGB, "bayer_rggb8"},
                       {PIXELS_GBRG, "bayer_gbrg8"},
                       {PIXELS_GRBG, "bayer_grbg8"},
                       {PIXELS_BGGR, "bayer_bggr8"}};
    static const int layouts[] = {DDX_VIDEO_420,   DDX_VIDEO_YUV422P, DDX_VIDEO_YUV444P,
                                  DDX_VIDEO_GREY8, DDX_VIDEO_GREY16,  DDX_VIDEO_RGB24};
    bool asked = true;
    scratch_make();
    test_by_hand();
    test_refusals();
    for (enum pixels_coding coding = PIXELS_YU12; coding <= PIXELS_BGGR16; coding++)
        for (size_t i = 0; !pixels_find(coding)->compressed && i < sizeof(layouts) / sizeof(*layouts); i++) {
            test_on_each_processor(coding, layouts[i], 128, 96);
            test_on_each_processor(coding, layouts[i], 88, 72);
        }
    for (size_t i = 0; i < sizeof(formats) / sizeof(*formats); i++) {
        for (int order = PIXELS_INTERLEAVED; order <= PIXELS_BOTTOM_TOP; order++)
            for (int stack = 0; stack < 2; stack++)
                test_fields(formats[i].coding, (enum pixels_order)order, stack);
        asked &= test_against_ffmpeg(formats[i].coding, formats[i].name, 128, 96);
        asked &= test_against_ffmpeg(formats[i].coding, formats[i].name, 88, 72);
    }
    for (size_t i = 0; i < sizeof(progressive) / sizeof(*progressive); i++) {
        asked &= test_against_ffmpeg(progressive[i].coding, progressive[i].name, 128, 96);
        asked &= test_against_ffmpeg(progressive[i].coding, progressive[i].name, 88, 72);
    }
    if (!asked)
        SKIP("no ffmpeg here to compare with");
    return 0;
}
