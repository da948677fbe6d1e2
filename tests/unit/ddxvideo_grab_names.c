/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Names of sizes, standards and inputs as people type them; shapes of pixels. */
#include "check.h"
#include "geometry.h"
#include "device.h"

static void test_sizes(void) {
    static const struct {
        const char *text;
        int width, height; /* 0: refused */
    } table[] = {
        {"QCIF", 176, 144},
        {"cif", 352, 288},
        {"4CIF", 704, 576},
        {"vga", 640, 480},
        {"PAL", 720, 576},
        {"NTSC", 720, 480},
        {"720p", 1280, 720},
        {"1080P", 1920, 1080},
        {"2x2", 2, 2},
        {"8192x8192", 8192, 8192},
        {"8194x2", 0, 0},
        {"2x8194", 0, 0},
        {"351x288", 0, 0},
        {"352x287", 0, 0},
        {"0x0", 0, 0},
        {"352", 0, 0},
        {"352x", 0, 0},
        {"x288", 0, 0},
        {"-2x2", 0, 0},
        {"352x288 ", 0, 0},
        {"352X288", 0, 0},
        {"99999999999x2", 0, 0},
        {"", 0, 0},
        {"CIFX", 0, 0},
        {"0352x0288", 352, 288},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        int width = 0, height = 0;
        CHECK_EQUAL(size_parse(table[i].text, &width, &height), table[i].width != 0);
        CHECK_EQUAL(width, table[i].width);
        CHECK_EQUAL(height, table[i].height);
    }
}

static void test_standards(void) {
    v4l2_std_id standard;
    CHECK(input_parse_standard("pal", &standard) && standard == V4L2_STD_PAL);
    CHECK(input_parse_standard("NTSC", &standard) && standard == V4L2_STD_NTSC);
    CHECK(input_parse_standard("Secam", &standard) && standard == V4L2_STD_SECAM);
    CHECK(!input_parse_standard("PA", &standard) && !input_parse_standard("", &standard));
}

static void test_inputs(void) {
    struct v4l2_input input = {.index = 2, .name = "S-Video 000-0"};
    CHECK(input_is_meant(&input, "2") && input_is_meant(&input, "s-video") && input_is_meant(&input, "S-Video 000-0"));
    CHECK(!input_is_meant(&input, "1") && !input_is_meant(&input, "22") && !input_is_meant(&input, "Composite"));
    CHECK(!input_is_meant(&input, "-2") && !input_is_meant(&input, "2nd"));
}

static void test_geometry(void) {
    const struct video_layout *paper = video_layout_of(DDX_VIDEO_420);
    /* PAL by its standard: 59/54 at 720x576; as CIF the same picture has 59/54 * (720/352) / (576/288) */
    struct ddxvideo_geometry pal = {.width = 720,
                                    .height = 576,
                                    .fields = 1,
                                    .rate_num = 25,
                                    .rate_den = 1,
                                    .aspect_num = 59,
                                    .aspect_den = 54,
                                    .interlacing = 't'};
    struct ddxvideo_geometry cif = geometry_of_result(&pal, 352, 288, 5, false, paper);
    CHECK_EQUAL(cif.width, 352);
    CHECK_EQUAL(cif.height, 288);
    CHECK_EQUAL((int64_t)cif.aspect_num * 54 * 352 * 2, (int64_t)cif.aspect_den * 59 * 720);
    CHECK_EQUAL(cif.rate_num, 5); /* the paper: 25 fps PAL with -skip 5 gives 5 Hz */
    CHECK_EQUAL(cif.rate_den, 1);
    CHECK_EQUAL(cif.interlacing, 't');
    struct ddxvideo_geometry pair = geometry_of_result(&pal, 0, 0, 1, true, paper);
    CHECK_EQUAL(pair.fields, 2);
    CHECK_EQUAL(pair.height, 576);
    CHECK_EQUAL(pair.interlacing, 'p');
    CHECK_EQUAL(pair.aspect_num * 108, pair.aspect_den * 59);
    struct ddxvideo_geometry odd = {.width = 175, .height = 143, .fields = 1};
    odd = geometry_of_result(&odd, 0, 0, 3, false, paper);
    CHECK_EQUAL(odd.width, 174);
    CHECK_EQUAL(odd.height, 142);
    CHECK_EQUAL(odd.rate_num, 0);
    CHECK(!ddxvideo_geometry_error(&cif) && !ddxvideo_geometry_error(&pair) && !ddxvideo_geometry_error(&odd));
    /* numbers that would not fit */
    struct ddxvideo_geometry huge = {.width = 8190,
                                     .height = 8192,
                                     .fields = 1,
                                     .rate_num = 1000000007,
                                     .rate_den = 1000000006,
                                     .aspect_num = 1000003,
                                     .aspect_den = 1000001};
    huge = geometry_of_result(&huge, 8188, 8186, 100000, true, paper);
    CHECK(huge.rate_num > 0 && huge.rate_den / huge.rate_num >= 99000 && huge.rate_den / huge.rate_num <= 101000);
    CHECK(huge.aspect_num > 0 && huge.aspect_den / huge.aspect_num <= 2);
}

static void test_geometry_of_layouts(void) {
    static const struct {
        int format, width, height, range;
    } wanted[] = {
        {DDX_VIDEO_420, 174, 142, DDX_VIDEO_RANGE_LIMITED},     {DDX_VIDEO_YUV422P, 174, 143, DDX_VIDEO_RANGE_LIMITED},
        {DDX_VIDEO_YUV444P, 175, 143, DDX_VIDEO_RANGE_LIMITED}, {DDX_VIDEO_GREY8, 175, 143, DDX_VIDEO_RANGE_LIMITED},
        {DDX_VIDEO_GREY16, 175, 143, DDX_VIDEO_RANGE_LIMITED},  {DDX_VIDEO_RGB24, 175, 143, DDX_VIDEO_RANGE_FULL}};
    const struct ddxvideo_geometry camera = {
        .width = 175, .height = 143, .fields = 1, .format = DDX_VIDEO_420_JPEG, .range = DDX_VIDEO_RANGE_LIMITED};
    for (size_t i = 0; i < sizeof(wanted) / sizeof(*wanted); i++) {
        struct ddxvideo_geometry result =
            geometry_of_result(&camera, 0, 0, 1, false, video_layout_of(wanted[i].format));
        CHECK_EQUAL(result.width, wanted[i].width);
        CHECK_EQUAL(result.height, wanted[i].height);
        CHECK_EQUAL(result.range, wanted[i].range);
        CHECK_EQUAL(result.format, i ? wanted[i].format : DDX_VIDEO_420_JPEG);
        CHECK(!ddxvideo_geometry_error(&result));
    }
}

int main(void) {
    test_geometry_of_layouts();
    test_sizes();
    test_standards();
    test_inputs();
    test_geometry();
    return 0;
}
