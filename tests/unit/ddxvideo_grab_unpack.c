/* SPDX-License-Identifier: GPL-2.0-or-later */
/* IIDC's codings, rearranged: each sample is in its place, and padding is left out. */
#include "check.h"
#include "convert.h"
#include "pixels.h"

#define WIDTH 16
#define HEIGHT 6
#define PADDING 5

static unsigned char data[(6 * WIDTH + PADDING) * HEIGHT], unpacked[4 * WIDTH * HEIGHT];

/* One sample of the picture, different for each place and colour. */
static unsigned sample(int row, int x, int colour) {
    return (unsigned)(row * 31 + x * 7 + colour * 101 + 3) & 0xff;
}

static struct pixels picture(enum pixels_coding coding, int row_bytes) {
    memset(data, 0xee, sizeof(data));
    return (struct pixels){
        .coding = coding, .width = WIDTH, .height = HEIGHT, .stride = row_bytes + PADDING, .depth = 16};
}

static void check_planes(const struct pixels *pixels, int share) {
    unsigned char *plane[3];
    int stride[3];
    CHECK(unpack_size(pixels) <= sizeof(unpacked));
    memset(unpacked, 0xdd, sizeof(unpacked));
    unpack_run(pixels, data, unpacked, plane, stride);
    for (int row = 0; row < HEIGHT; row++) {
        for (int x = 0; x < WIDTH; x++)
            CHECK_EQUAL(plane[0][row * stride[0] + x], sample(row, x, 0));
        for (int x = 0; x < WIDTH / share; x++) {
            CHECK_EQUAL(plane[1][row * stride[1] + x], sample(row, x, 1));
            CHECK_EQUAL(plane[2][row * stride[2] + x], sample(row, x, 2));
        }
    }
    for (size_t i = unpack_size(pixels); i < sizeof(unpacked); i++)
        CHECK_EQUAL(unpacked[i], 0xdd);
}

static void test_411(void) {
    struct pixels pixels = picture(PIXELS_YUV411, WIDTH * 3 / 2);
    for (int row = 0; row < HEIGHT; row++) {
        for (int x = 0; x < WIDTH / 4; x++) {
            unsigned char *at = data + row * pixels.stride + 6 * x;
            const unsigned bytes[] = {sample(row, x, 1), sample(row, 4 * x, 0),     sample(row, 4 * x + 1, 0),
                                      sample(row, x, 2), sample(row, 4 * x + 2, 0), sample(row, 4 * x + 3, 0)};
            for (int i = 0; i < 6; i++)
                at[i] = (unsigned char)bytes[i];
        }
    }
    check_planes(&pixels, 4);
}

static void test_444(void) {
    struct pixels pixels = picture(PIXELS_YUV444, WIDTH * 3);
    for (int row = 0; row < HEIGHT; row++) {
        for (int x = 0; x < WIDTH; x++) {
            unsigned char *at = data + row * pixels.stride + 3 * x;
            at[0] = (unsigned char)sample(row, x, 1);
            at[1] = (unsigned char)sample(row, x, 0);
            at[2] = (unsigned char)sample(row, x, 2);
        }
    }
    check_planes(&pixels, 1);
}

static unsigned first_sample(const struct pixels *pixels, unsigned high, unsigned low) {
    unsigned char *plane[3];
    int stride[3];
    data[0] = (unsigned char)high;
    data[1] = (unsigned char)low;
    unpack_run(pixels, data, unpacked, plane, stride);
    CHECK(!plane[1] && !plane[2]);
    return unpacked[0];
}

static void test_16_bits(void) {
    struct pixels pixels = picture(PIXELS_GREY16, 2 * WIDTH);
    CHECK_EQUAL(unpack_size(&pixels), (2 * WIDTH + PADDING) / 2 * HEIGHT);
    CHECK_EQUAL(first_sample(&pixels, 0xab, 0xcd), 0xab);
    pixels.depth = 12;
    CHECK_EQUAL(first_sample(&pixels, 0x0a, 0xbc), 0xab);
    CHECK_EQUAL(first_sample(&pixels, 0x1a, 0xbc), 0xff); /* more bits than it says */
    pixels.depth = 8;
    CHECK_EQUAL(first_sample(&pixels, 0x00, 0xcd), 0xcd);
}

/* Through the converter, as in the grabber: luma and the chroma of a uniform colour are unchanged. */
static void test_converted(enum pixels_coding coding, int row_bytes, const unsigned char *pattern, int length) {
    struct pixels pixels = {.coding = coding, .width = WIDTH, .height = HEIGHT, .stride = row_bytes, .depth = 16};
    unsigned char y[WIDTH * HEIGHT], u[WIDTH * HEIGHT / 4], v[WIDTH * HEIGHT / 4];
    struct converter converter;
    for (int i = 0; i < row_bytes * HEIGHT; i++)
        data[i] = pattern[i % length];
    const struct ddxvideo_geometry paper = {.width = WIDTH, .height = HEIGHT};
    CHECK_EQUAL(converter_open(&converter, &pixels, 0, &paper, false), 0);
    unsigned char *const to[3] = {y, u, v};
    const int stride[3] = {WIDTH, WIDTH / 2, WIDTH / 2};
    CHECK_EQUAL(converter_run(&converter, data, (size_t)(row_bytes * HEIGHT - 1), to, stride), -74);
    CHECK_EQUAL(converter_run(&converter, data, (size_t)(row_bytes * HEIGHT), to, stride), 0);
    bool grey = pixels_find(coding)->libav == AV_PIX_FMT_GRAY8;
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        CHECK_EQUAL(y[i], grey ? 0x42 : 77);
    for (int i = 0; i < WIDTH * HEIGHT / 4; i++) {
        CHECK_EQUAL(u[i], grey ? 128 : 55);
        CHECK_EQUAL(v[i], grey ? 128 : 200);
    }
    converter_close(&converter);
}

int main(void) {
    test_411();
    test_444();
    test_16_bits();
    test_converted(PIXELS_YUV411, WIDTH * 3 / 2, (const unsigned char[]){55, 77, 77, 200, 77, 77}, 6);
    test_converted(PIXELS_YUV444, WIDTH * 3, (const unsigned char[]){55, 77, 200}, 3);
    test_converted(PIXELS_GREY16, WIDTH * 2, (const unsigned char[]){0x42, 0x99}, 2);
    test_converted(PIXELS_Y16, WIDTH * 2, (const unsigned char[]){0x99, 0x42}, 2);
    return 0;
}
