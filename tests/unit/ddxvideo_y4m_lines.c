/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Header and FRAME lines: read, written, and refused with which words. */
#include "check.h"
#include "y4m.h"

#define Y "YUV4MPEG2"

static void test_good_headers(void) {
    static const struct {
        const char *line;
        int width, height, fields, rate_num, rate_den, aspect_num, aspect_den, format, interlacing, range;
    } table[] = {
        {Y " W352 H288", 352, 288, 1, 0, 0, 0, 0, DDX_VIDEO_420_JPEG, 0, 0},
        {Y " W352 H288 F25:1 Ip A128:117 C420mpeg2 XYSCSS=420MPEG2", 352, 288, 1, 25, 1, 128, 117, DDX_VIDEO_420_MPEG2,
         'p', 0},
        {Y " H480  W640 F30000:1001 It A1:1 C420paldv", 640, 480, 1, 30000, 1001, 1, 1, DDX_VIDEO_420_PALDV, 't', 0},
        {Y " W2 H2 F0:0 I? A0:0 C420", 2, 2, 1, 0, 0, 0, 0, DDX_VIDEO_420, '?', 0},
        {Y " W8192 H8192 C444p16", 8192, 8192, 1, 0, 0, 0, 0, DDX_VIDEO_420_MPEG2, 0, 0},
        {Y " W4 H12 XDDX_FIELDS=3 XCOLORRANGE=FULL", 4, 12, 3, 0, 0, 0, 0, DDX_VIDEO_420_JPEG, 0, 2},
        {Y " W2 H2 F3000000:1 Ip", 2, 2, 1, 0, 0, 0, 0, DDX_VIDEO_420_JPEG, 'p', 0}, /* no source has this rate */
        {Y " W2 H2 F2147483647:2147483647", 2, 2, 1, INT32_MAX, INT32_MAX, 0, 0, DDX_VIDEO_420_JPEG, 0, 0},
        {Y " W4 H4 XCOLORRANGE=LIMITED Zsomething X ", 4, 4, 1, 0, 0, 0, 0, DDX_VIDEO_420_JPEG, 0, 1},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct y4m_header header;
        char error[Y4M_ERROR_MAX] = "";
        CHECK(y4m_parse_header(table[i].line, DDX_VIDEO_420, &header, error));
        if (*error)
            fprintf(stderr, "%s: %s\n", table[i].line, error);
        const struct ddxvideo_geometry *g = &header.geometry;
        CHECK_EQUAL(g->width, table[i].width);
        CHECK_EQUAL(g->height, table[i].height);
        CHECK_EQUAL(g->fields, table[i].fields);
        CHECK_EQUAL(g->rate_num, table[i].rate_num);
        CHECK_EQUAL(g->rate_den, table[i].rate_den);
        CHECK_EQUAL(g->aspect_num, table[i].aspect_num);
        CHECK_EQUAL(g->aspect_den, table[i].aspect_den);
        CHECK_EQUAL(g->format, table[i].format);
        CHECK_EQUAL(g->interlacing, table[i].interlacing);
        CHECK_EQUAL(g->range, table[i].range);
    }
}

static void test_layouts(void) {
    static const struct {
        const char *tag;
        size_t bytes[4]; /* of planes of a 10x6 picture */
    } table[] = {
        {"420jpeg", {60, 15, 15, 0}}, {"420mpeg2", {60, 15, 15, 0}}, {"420paldv", {60, 15, 15, 0}},
        {"420", {60, 15, 15, 0}},     {"411", {60, 18, 18, 0}},      {"410", {60, 6, 6, 0}},
        {"422", {60, 30, 30, 0}},     {"444", {60, 60, 60, 0}},      {"444alpha", {60, 60, 60, 60}},
        {"mono", {60, 0, 0, 0}},      {"mono9", {120, 0, 0, 0}},     {"mono10", {120, 0, 0, 0}},
        {"mono12", {120, 0, 0, 0}},   {"mono16", {120, 0, 0, 0}},    {"420p9", {120, 30, 30, 0}},
        {"420p10", {120, 30, 30, 0}}, {"420p12", {120, 30, 30, 0}},  {"420p14", {120, 30, 30, 0}},
        {"420p16", {120, 30, 30, 0}}, {"422p9", {120, 60, 60, 0}},   {"422p10", {120, 60, 60, 0}},
        {"422p16", {120, 60, 60, 0}}, {"444p9", {120, 120, 120, 0}}, {"444p16", {120, 120, 120, 0}},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct y4m_header header;
        char line[80], error[Y4M_ERROR_MAX] = "";
        snprintf(line, sizeof(line), Y " W10 H6 C%s", table[i].tag);
        CHECK(y4m_parse_header(line, DDX_VIDEO_420, &header, error));
        CHECK(y4m_is_plain(&header) == (table[i].bytes[1] == 15));
        for (int plane = 0; plane < 4; plane++)
            CHECK_EQUAL(y4m_plane_bytes(&header, plane), table[i].bytes[plane]);
    }
}

/* Layouts of a file by the requested layout; -1: impossible. Odd sides need chroma that is not shared. */
static void test_formats(void) {
    static const struct {
        const char *words;
        int wanted, format;
        bool plain;
    } table[] = {
        {"W10 H6 C422", Y4M_SAME, DDX_VIDEO_YUV422P, true},
        {"W10 H6 C444", Y4M_SAME, DDX_VIDEO_YUV444P, true},
        {"W10 H6 Cmono", Y4M_SAME, DDX_VIDEO_GREY8, true},
        {"W10 H6 Cmono16", Y4M_SAME, DDX_VIDEO_GREY16, true},
        {"W10 H6 C420paldv", Y4M_SAME, DDX_VIDEO_420_PALDV, true},
        {"W10 H6 C444alpha", Y4M_SAME, DDX_VIDEO_420_MPEG2, false},
        {"W10 H6 Cmono10", Y4M_SAME, DDX_VIDEO_420_JPEG, false},
        {"W10 H6 C444", DDX_VIDEO_420, DDX_VIDEO_420_MPEG2, false},
        {"W10 H6 C444alpha", DDX_VIDEO_YUV444P, DDX_VIDEO_YUV444P, false},
        {"W10 H6 C420jpeg", DDX_VIDEO_RGB24, DDX_VIDEO_RGB24, false},
        {"W9 H5 Cmono16", Y4M_SAME, DDX_VIDEO_GREY16, true},
        {"W9 H5 C444", DDX_VIDEO_YUV444P, DDX_VIDEO_YUV444P, true},
        {"W9 H5 Cmono", DDX_VIDEO_420, -1, false},
        {"W10 H5 C422", DDX_VIDEO_YUV422P, DDX_VIDEO_YUV422P, true},
        {"W9 H5 C422", DDX_VIDEO_YUV422P, -1, false},
        {"W9 H6 Cmono XDDX_FIELDS=2", DDX_VIDEO_GREY8, DDX_VIDEO_GREY8, true},
        {"W9 H5 Cmono XDDX_FIELDS=2", DDX_VIDEO_GREY8, -1, false},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct y4m_header header;
        char line[80], written[Y4M_HEADER_WRITTEN], error[Y4M_ERROR_MAX] = "";
        snprintf(line, sizeof(line), Y " %s", table[i].words);
        CHECK_EQUAL(y4m_parse_header(line, table[i].wanted, &header, error), table[i].format >= 0);
        CHECK((*error != 0) == (table[i].format < 0));
        if (*error)
            continue;
        CHECK_EQUAL(header.geometry.format, table[i].format);
        CHECK_EQUAL(y4m_is_plain(&header), table[i].plain);
        CHECK_EQUAL(header.geometry.range, table[i].format == DDX_VIDEO_RGB24 ? DDX_VIDEO_RANGE_FULL : 0);
        CHECK_EQUAL(y4m_has(header.geometry.format), table[i].format != DDX_VIDEO_RGB24);
        if (!table[i].plain)
            continue;
        struct ddxvideo_geometry before = header.geometry;
        written[y4m_write_header(written, &before) - 1] = 0;
        CHECK(y4m_parse_header(written, Y4M_SAME, &header, error));
        CHECK(ddxvideo_same_layout(&header.geometry, &before) || header.geometry.interlacing == '?');
        CHECK_EQUAL(header.geometry.format, before.format);
    }
}

static void test_bad_headers(void) {
    static const struct {
        const char *line, *text; /* the text names the fault, and after a semicolon the remedy */
    } table[] = {
        {"", "no Y4M"},
        {"YUV4MPEG", "no Y4M"},
        {"YUV4MPEG22 W2 H2", "no Y4M"},
        {"RIFF", "no Y4M"},
        {Y, "missing"},
        {Y " W352", "missing"},
        {Y " W0 H288", "zero"},
        {Y " W352 H0", "zero"},
        {Y " W-2 H288", "no size"},
        {Y " W352x H288", "no size"},
        {Y " W H288", "no size"},
        {Y " W99999999999999999999 H288", "no size"},
        {Y " W8194 H288", "too large"},
        {Y " W2147483647 H2147483647", "too large"},
        {Y " W351 H288", "odd size 351x288"},
        {Y " W352 H287", "odd size 352x287"},
        {Y " W2 H2 F25", "frame rate"},
        {Y " W2 H2 F25:0", "frame rate"},
        {Y " W2 H2 F0:1", "frame rate"},
        {Y " W2 H2 F-25:1", "frame rate"},
        {Y " W2 H2 F25:1x", "frame rate"},
        {Y " W2 H2 F9999999999:1", "frame rate"},
        {Y " W2 H2 A1", "pixel aspect"},
        {Y " W2 H2 Ix", "interlacing"},
        {Y " W2 H2 I", "interlacing"},
        {Y " W2 H2 Ipp", "interlacing"},
        {Y " W2 H2 C", "colourspace"},
        {Y " W2 H2 C421", "colourspace"},
        {Y " W2 H2 C420p11", "colourspace"},
        {Y " W2 H2 XDDX_FIELDS=0", "stacked"},
        {Y " W2 H2 XDDX_FIELDS=17", "stacked"},
        {Y " W2 H2 XDDX_FIELDS=", "stacked"},
        {Y " W4 H4 XDDX_FIELDS=3", "fields"},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct y4m_header header;
        char error[Y4M_ERROR_MAX] = "";
        CHECK(!y4m_parse_header(table[i].line, DDX_VIDEO_420, &header, error));
        if (!strstr(error, table[i].text)) {
            fprintf(stderr, "'%s': '%s' does not say '%s'\n", table[i].line, error, table[i].text);
            exit(1);
        }
        CHECK(strchr(error, ';'));
    }
    char line[3 * Y4M_HEADER_MAX] = Y " W2 H2 X", error[Y4M_ERROR_MAX] = "";
    struct y4m_header header;
    memset(line + strlen(line), 'x', sizeof(line) - 100);
    CHECK(!y4m_parse_header(line, DDX_VIDEO_420, &header, error) && strstr(error, "longer"));
    CHECK(!y4m_parse_header(Y " W2 H2 C\x1b[31m\xff", DDX_VIDEO_420, &header, error) && !strchr(error, '\x1b'));
}

static void test_frame_lines(void) {
    static const struct {
        const char *line;
        bool good;
        int64_t time;
    } table[] = {
        {"FRAME", true, -1},
        {"FRAME ", true, -1},
        {"FRAME Ip XTIME=0", true, 0},
        {"FRAME XTIME=123456789012 Xother", true, 123456789012},
        {"FRAME XTIME=1000000000000000000", true, Y4M_TIME_MAX},
        {"FRAME XTIMES=3", true, -1},
        {"FRAMEX", false, 0},
        {"frame", false, 0},
        {"", false, 0},
        {"FRAME XTIME=", false, 0},
        {"FRAME XTIME=-1", false, 0},
        {"FRAME XTIME=1x", false, 0},
        {"FRAME XTIME=1000000000000000001", false, 0},
        {"FRAME XTIME=99999999999999999999999", false, 0},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        int64_t time;
        char error[Y4M_ERROR_MAX];
        CHECK(y4m_parse_frame(table[i].line, &time, error) == table[i].good);
        if (table[i].good)
            CHECK_EQUAL(time, table[i].time);
    }
}

static void test_writing(void) {
    char line[Y4M_HEADER_WRITTEN], frame[Y4M_FRAME_LINE_WRITTEN], error[Y4M_ERROR_MAX];
    struct ddxvideo_geometry geometry = {.width = 8192,
                                         .height = 8192,
                                         .fields = 16,
                                         .rate_num = 30000,
                                         .rate_den = 1001,
                                         .aspect_num = 128,
                                         .aspect_den = 117,
                                         .format = DDX_VIDEO_420_MPEG2,
                                         .interlacing = 't',
                                         .range = DDX_VIDEO_RANGE_LIMITED};
    CHECK_EQUAL(y4m_write_header(line, &geometry), strlen(line));
    CHECK(!strcmp(line, Y " W8192 H8192 F30000:1001 It A128:117 C420mpeg2 XDDX_FIELDS=16\n"));
    geometry.fields = 1; /* room for XCOLORRANGE again */
    CHECK_EQUAL(y4m_write_header(line, &geometry), strlen(line));
    CHECK(strstr(line, "C420mpeg2 XCOLORRANGE=LIMITED\n") && strlen(line) < Y4M_LINE_PLAYED);
    struct y4m_header header;
    *strchr(line, '\n') = 0;
    CHECK(y4m_parse_header(line, DDX_VIDEO_420, &header, error));
    CHECK(!memcmp(&header.geometry, &geometry, sizeof(geometry)));

    /* Unreasonable, but complete. */
    geometry.fields = 16;
    geometry.rate_num = geometry.rate_den = geometry.aspect_num = geometry.aspect_den = INT32_MAX;
    CHECK_EQUAL(y4m_write_header(line, &geometry), strlen(line));
    CHECK(strstr(line, " XDDX_FIELDS=16\n"));

    geometry = (struct ddxvideo_geometry){.width = 2, .height = 2, .fields = 1};
    CHECK_EQUAL(y4m_write_header(line, &geometry), strlen(line));
    CHECK(!strcmp(line, Y " W2 H2 F25:1 I? A0:0 C420\n"));

    CHECK_EQUAL(y4m_write_frame(frame, Y4M_TIME_MAX, 0, -1), strlen(frame));
    CHECK(!strcmp(frame, "FRAME XTIME=1000000000000000000\n"));
    CHECK_EQUAL(y4m_write_frame(frame, 0, Y4M_TIME_MAX, INT64_C(9000000000000000000)), strlen(frame));
    CHECK(strlen(frame) < Y4M_LINE_PLAYED);
    CHECK(strstr(frame, "0 XDDX_START=1000000000000000000 XDDX_WALL=9000000000000000000\n"));
}

int main(void) {
    test_good_headers();
    test_layouts();
    test_formats();
    test_bad_headers();
    test_frame_lines();
    test_writing();
    return 0;
}
