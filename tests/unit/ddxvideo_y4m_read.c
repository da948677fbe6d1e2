/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reading files: whole and cut ones, any layout, pipes; every prefix of a file gives a result and never a crash. */
#include <sys/wait.h>
#include <unistd.h>

#include "../scratch.h"
#include "check.h"
#include "video_layout.h"
#include "y4m.h"

#define WIDTH 10
#define HEIGHT 6
#define PLANES (WIDTH * HEIGHT * 3 / 2)

static char *path;
static int wanted = DDX_VIDEO_420; /* format of the pictures */

static void write_path(const void *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    CHECK(file && fwrite(bytes, 1, size, file) == size);
    fclose(file);
}

/* A file of `frames` frames whose samples count up; returns its size. */
static size_t make(unsigned char *bytes, const char *tag, size_t frame_bytes, int frames, bool times) {
    size_t size = (size_t)sprintf((char *)bytes, "YUV4MPEG2 W%d H%d F25:1 C%s\n", WIDTH, HEIGHT, tag);
    for (int i = 0; i < frames; i++) {
        size += (size_t)(times ? sprintf((char *)bytes + size, "FRAME XTIME=%d\n", i * 1000)
                               : sprintf((char *)bytes + size, "FRAME\n"));
        for (size_t j = 0; j < frame_bytes; j++)
            bytes[size++] = (unsigned char)(i * 7 + (int)j);
    }
    return size;
}

/* Plays the file; returns its whole frames and how it ended. */
static int play(enum y4m_result *end, bool check_content) {
    struct y4m_reader reader;
    int frames = 0;
    int64_t time;
    *end = y4m_open(&reader, path, wanted);
    /* A damaged header may state another size; the planes have exactly that size. */
    const struct ddxvideo_geometry *geometry = &reader.header.geometry;
    unsigned char *picture = malloc(video_layout_bytes(geometry) + 1), *plane[3] = {picture};
    for (int i = 0; i < 2; i++) {
        int stride, rows;
        video_layout_plane(video_layout_of(geometry->format), geometry->width, geometry->height, i, &stride, &rows);
        plane[i + 1] = plane[i] + stride * rows;
    }
    while (*end == Y4M_OK) {
        *end = y4m_read(&reader, plane, &time);
        if (*end != Y4M_OK)
            break;
        int bytes = (int)video_layout_bytes(geometry);
        for (int j = 0; check_content && j < bytes; j++)
            if (picture[j] != (unsigned char)(frames * 7 + j)) {
                fprintf(stderr, "frame %d differs at %d\n", frames, j);
                exit(1);
            }
        frames++;
    }
    if (*end == Y4M_BAD)
        CHECK(*reader.error);
    y4m_close(&reader);
    free(picture);
    return frames;
}

static void test_every_prefix(bool times) {
    static unsigned char bytes[4096];
    enum y4m_result end;
    size_t size = make(bytes, "420", PLANES, 3, times);
    size_t header = strcspn((char *)bytes, "\n") + 1, frame = (size - header) / 3;
    for (size_t cut = 0; cut <= size; cut++) {
        write_path(bytes, cut);
        int frames = play(&end, true);
        if (times)
            continue; /* lines differ in length */
        CHECK_EQUAL(frames, cut < header ? 0 : (cut - header) / frame);
        CHECK_EQUAL(end, cut >= header && (cut - header) % frame == 0 ? Y4M_END : Y4M_BAD);
    }
}

static void test_damage(void) {
    static unsigned char bytes[4096];
    enum y4m_result end;
    size_t size = make(bytes, "420", PLANES, 3, true);
    size_t header = strcspn((char *)bytes, "\n") + 1;
    for (size_t at = 0; at < header + 20; at++) {
        for (int bit = 0; bit < 8; bit++) {
            bytes[at] ^= (unsigned char)(1 << bit);
            write_path(bytes, size);
            play(&end, false);
            bytes[at] ^= (unsigned char)(1 << bit);
        }
    }
    memset(bytes, 'x', sizeof(bytes));
    write_path(bytes, sizeof(bytes));
    CHECK_EQUAL(play(&end, false), 0);
    CHECK_EQUAL(end, Y4M_BAD);
}

static void test_layouts(void) {
    static const struct {
        const char *tag;
        size_t frame;
    } table[] = {
        {"411", 96},     {"410", 72},     {"422", 120},    {"444", 180},    {"444alpha", 240}, {"mono", 60},
        {"mono9", 120},  {"420p9", 180},  {"422p9", 240},  {"444p9", 360},  {"mono10", 120},   {"420p10", 180},
        {"422p10", 240}, {"444p10", 360}, {"mono12", 120}, {"420p12", 180}, {"422p12", 240},   {"444p12", 360},
        {"mono14", 120}, {"420p14", 180}, {"422p14", 240}, {"444p14", 360}, {"mono16", 120},   {"420p16", 180},
        {"422p16", 240}, {"444p16", 360},
    };
    static unsigned char bytes[8192];
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        enum y4m_result end;
        size_t size = make(bytes, table[i].tag, table[i].frame, 5, true);
        write_path(bytes, size);
        for (int format = DDX_VIDEO_YUV422P; format <= DDX_VIDEO_RGB24; format++) {
            wanted = format;
            CHECK_EQUAL(play(&end, false), 5);
            CHECK_EQUAL(end, Y4M_END);
        }
        wanted = DDX_VIDEO_420;
        CHECK_EQUAL(play(&end, false), 5);
        CHECK_EQUAL(end, Y4M_END);
        write_path(bytes, size - 1);
        CHECK_EQUAL(play(&end, false), 4);
        CHECK_EQUAL(end, Y4M_BAD);
    }
}

/* The store's own layouts are read byte for byte. */
static void test_same_bytes(void) {
    static const struct {
        const char *tag;
        size_t frame;
        int format;
    } table[] = {{"422", 120, DDX_VIDEO_YUV422P},
                 {"444", 180, DDX_VIDEO_YUV444P},
                 {"mono", 60, DDX_VIDEO_GREY8},
                 {"mono16", 120, DDX_VIDEO_GREY16}};
    static unsigned char bytes[8192];
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        enum y4m_result end;
        write_path(bytes, make(bytes, table[i].tag, table[i].frame, 3, true));
        wanted = table[i].format;
        CHECK_EQUAL(play(&end, true), 3);
        CHECK_EQUAL(end, Y4M_END);
    }
    wanted = DDX_VIDEO_420;
}

/* A picture of one colour, converted from one layout to another. Samples of more than 8 bits are little endian. */
static void check_colour(const char *tag, int bits, const unsigned colour[3], const char *words, int format,
                         const unsigned expected[3]) {
    static unsigned char bytes[8192];
    struct y4m_reader reader;
    unsigned char planes[3][WIDTH * HEIGHT * 3], *const plane[3] = {planes[0], planes[1], planes[2]};
    int64_t time;
    size_t size = (size_t)sprintf((char *)bytes, "YUV4MPEG2 W%d H%d C%s %s\nFRAME\n", WIDTH, HEIGHT, tag, words);
    write_path(bytes, size);
    CHECK_EQUAL(y4m_open(&reader, path, format), Y4M_OK);
    for (int i = 0; i < 3; i++)
        for (size_t left = y4m_plane_bytes(&reader.header, i); left; left -= bits > 8 ? 2 : 1) {
            bytes[size++] = (unsigned char)colour[i];
            if (bits > 8)
                bytes[size++] = (unsigned char)(colour[i] >> 8);
        }
    y4m_close(&reader);
    write_path(bytes, size);
    CHECK_EQUAL(y4m_open(&reader, path, format), Y4M_OK);
    CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_OK);
    const struct video_layout *layout = video_layout_of(format);
    for (int i = 0; i < 3; i++) {
        int stride, rows;
        video_layout_plane(layout, WIDTH, HEIGHT, i, &stride, &rows);
        for (int at = 0; at < stride * rows; at += layout->bytes) {
            int value = layout->bytes == 2 ? planes[i][at] | planes[i][at + 1] << 8 : planes[i][at];
            int right = (int)expected[layout->samples == 3 ? at % 3 : i];
            if (value < right - (layout->samples == 3) || value > right + (layout->samples == 3)) {
                fprintf(stderr, "C%s %s as %s: plane %d has %d, not %d\n", tag, words, layout->name, i, value, right);
                exit(1);
            }
        }
    }
    y4m_close(&reader);
}

static void test_colours(void) {
    static const struct {
        const char *tag;
        int bits;
        unsigned colour[3];
        const char *words;
        int format;
        unsigned expected[3];
    } table[] = {
        {"mono", 8, {77}, "", DDX_VIDEO_YUV444P, {77, 128, 128}},
        {"mono", 8, {77}, "", DDX_VIDEO_420, {77, 128, 128}},
        {"mono", 8, {77}, "", DDX_VIDEO_GREY16, {77 << 8}},
        {"mono16", 16, {0x1234}, "", DDX_VIDEO_GREY8, {0x12}},
        {"mono16", 16, {0xffff}, "", DDX_VIDEO_YUV422P, {255, 128, 128}},
        {"mono10", 10, {0x3ff}, "", DDX_VIDEO_GREY16, {0xffc0}},
        {"mono", 8, {235}, "", DDX_VIDEO_RGB24, {255, 255, 255}},
        {"mono", 8, {3}, "", DDX_VIDEO_RGB24, {0, 0, 0}},
        {"mono", 8, {235}, "XCOLORRANGE=FULL", DDX_VIDEO_RGB24, {235, 235, 235}},
        {"422", 8, {50, 60, 70}, "", DDX_VIDEO_YUV444P, {50, 60, 70}},
        {"444", 8, {50, 60, 70}, "It", DDX_VIDEO_YUV422P, {50, 60, 70}},
        {"420jpeg", 8, {50, 60, 70}, "Ib", DDX_VIDEO_YUV422P, {50, 60, 70}},
        {"444p10", 10, {50 << 2, 60 << 2, 70 << 2}, "", DDX_VIDEO_YUV444P, {50, 60, 70}},
        {"420p10", 10, {50 << 2, 60 << 2, 70 << 2}, "", DDX_VIDEO_GREY8, {50}},
        {"422", 8, {50, 60, 70}, "", DDX_VIDEO_GREY16, {50 << 8}},
        {"444", 8, {82, 90, 240}, "", DDX_VIDEO_RGB24, {255, 0, 0}},                      /* red */
        {"420jpeg", 8, {29, 255, 107}, "XCOLORRANGE=FULL", DDX_VIDEO_RGB24, {0, 0, 254}}, /* blue */
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++)
        check_colour(table[i].tag, table[i].bits, table[i].colour, table[i].words, table[i].format, table[i].expected);
}

static void test_pipe_and_rewind(void) {
    static unsigned char bytes[4096];
    struct y4m_reader reader;
    unsigned char picture[PLANES];
    unsigned char *const plane[3] = {picture, picture + WIDTH * HEIGHT, picture + WIDTH * HEIGHT / 4 * 5};
    int64_t time;
    size_t size = make(bytes, "420", PLANES, 3, true);
    write_path(bytes, size);
    CHECK_EQUAL(y4m_open(&reader, path, wanted), Y4M_OK);
    for (int pass = 0; pass < 3; pass++) {
        for (int i = 0; i < 3; i++) {
            CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_OK);
            CHECK_EQUAL(time, i * 1000);
            CHECK_EQUAL(picture[0], i * 7);
        }
        CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_END);
        CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_END);
        CHECK_EQUAL(y4m_rewind(&reader), Y4M_OK);
    }
    y4m_close(&reader);

    int ends[2];
    CHECK(!pipe(ends));
    pid_t child = fork();
    if (!child) { /* in small pieces */
        for (size_t at = 0; at < size; at += 13)
            if (write(ends[1], bytes + at, size - at < 13 ? size - at : 13) < 0)
                _exit(1);
        _exit(0);
    }
    close(ends[1]);
    char name[32];
    snprintf(name, sizeof(name), "/dev/fd/%d", ends[0]);
    CHECK_EQUAL(y4m_open(&reader, name, wanted), Y4M_OK);
    for (int i = 0; i < 3; i++)
        CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_OK);
    CHECK_EQUAL(y4m_read(&reader, plane, &time), Y4M_END);
    CHECK_EQUAL(y4m_rewind(&reader), Y4M_BAD);
    y4m_close(&reader);
    close(ends[0]);
    waitpid(child, NULL, 0);
}

static void test_no_file(void) {
    struct y4m_reader reader;
    CHECK_EQUAL(y4m_open(&reader, "/nonexistent/file", wanted), Y4M_BAD);
    CHECK(strstr(reader.error, "opened"));
    y4m_close(&reader);
    CHECK_EQUAL(y4m_open(&reader, "/tmp", wanted), Y4M_BAD);
    y4m_close(&reader);
}

int main(void) {
    scratch_make();
    path = scratch_path("clip.y4m");
    test_every_prefix(false);
    test_every_prefix(true);
    test_damage();
    test_layouts();
    test_same_bytes();
    test_colours();
    test_pipe_and_rewind();
    test_no_file();
    free(path);
    return 0;
}
