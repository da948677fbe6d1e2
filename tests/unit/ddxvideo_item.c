/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Valid and invalid geometries. tests/host tests reading and writing items. */
#include "ddxvideo.h"
#include "check.h"

static void test_geometry(void) {
    const struct ddxvideo_geometry good = {
        .width = 352, .height = 288, .fields = 2, .rate_num = 25, .rate_den = 1, .interlacing = 'p'};
    CHECK(!ddxvideo_geometry_error(&good));
    static const struct {
        size_t offset;
        int value;
        const char *text;
    } table[] = {
#define FIELD(name) offsetof(struct ddxvideo_geometry, name)
        {FIELD(width), 0, "zero"},
        {FIELD(height), -2, "zero"},
        {FIELD(width), 351, "even"},
        {FIELD(height), 287, "even"},
        {FIELD(width), 8194, "larger"},
        {FIELD(height), 2147483646, "larger"},
        {FIELD(fields), 0, "fields"},
        {FIELD(fields), 5, "fields"},
        {FIELD(fields), 17, "fields"},
        {FIELD(rate_num), 0, "rate"},
        {FIELD(rate_den), -1, "rate"},
        {FIELD(aspect_num), 1, "aspect"},
        {FIELD(format), 4, "format"},
        {FIELD(format), -1, "format"},
        {FIELD(interlacing), 'x', "interlacing"},
        {FIELD(interlacing), -1, "interlacing"},
        {FIELD(interlacing), 'p' + 256, "interlacing"},
        {FIELD(range), 3, "range"},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct ddxvideo_geometry bad = good;
        memcpy((char *)&bad + table[i].offset, &table[i].value, sizeof(int));
        const char *error = ddxvideo_geometry_error(&bad);
        CHECK(error && strstr(error, table[i].text));
    }
    /* Sides must be even where samples share chroma. */
    static const struct {
        int format, width, height, fields, good;
    } layouts[] = {{DDX_VIDEO_YUV422P, 352, 287, 1, 1}, {DDX_VIDEO_YUV422P, 351, 288, 1, 0},
                   {DDX_VIDEO_YUV444P, 351, 287, 1, 1}, {DDX_VIDEO_GREY8, 1, 1, 1, 1},
                   {DDX_VIDEO_GREY16, 351, 6, 2, 1},    {DDX_VIDEO_GREY16, 351, 5, 2, 0},
                   {DDX_VIDEO_RGB24, 3, 3, 3, 1},       {DDX_VIDEO_RGB24 + 1, 352, 288, 1, 0}};
    for (size_t i = 0; i < sizeof(layouts) / sizeof(*layouts); i++) {
        struct ddxvideo_geometry one = good;
        one.format = layouts[i].format;
        one.width = layouts[i].width;
        one.height = layouts[i].height;
        one.fields = layouts[i].fields;
        CHECK_EQUAL(!ddxvideo_geometry_error(&one), layouts[i].good);
    }
    CHECK(!strcmp(ddxvideo_layout_name(DDX_VIDEO_420_PALDV), "YUV420P"));
    CHECK(!strcmp(ddxvideo_layout_name(DDX_VIDEO_RGB24), "RGB24"));
    CHECK(!ddxvideo_layout_name(15) && !ddxvideo_layout_name(-1) && !ddxvideo_layout_name(DDX_VIDEO_RGB24 + 1));
    struct ddxvideo_geometry other = good;
    other.rate_num = 50;
    CHECK(ddxvideo_same_layout(&good, &other));
    other.fields = 1;
    CHECK(!ddxvideo_same_layout(&good, &other));
}

static void test_rates(void) {
    static const struct {
        int num, den, known;
    } table[] = {{25, 1, 1},
                 {30000, 1001, 1},
                 {1, INT32_MAX, 1},
                 {INT32_MAX, INT32_MAX, 1},
                 {10000, 1, 1},
                 {10001, 1, 0},
                 {3000000, 1, 0},
                 {INT32_MAX, 1, 0},
                 {INT32_MAX, 300000, 1},
                 {INT32_MAX, 200000, 0},
                 {0, 0, 0},
                 {25, 0, 0},
                 {0, 1, 0},
                 {-25, 1, 0},
                 {-25, -1, 0},
                 {25, -1, 0}};
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++)
        CHECK_EQUAL(ddxvideo_rate_known(table[i].num, table[i].den), table[i].known);
}

static void test_names(void) {
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *item;
    memset(name, 'x', DDX_NAME_MAX);
    name[DDX_NAME_MAX] = 0;
    CHECK_EQUAL(ddxvideo_counter_create(NULL, name, &item), -22);
    CHECK_EQUAL(ddxvideo_parameters_create(NULL, name, &item), -22);
}

int main(void) {
    test_geometry();
    test_rates();
    test_names();
    return 0;
}
