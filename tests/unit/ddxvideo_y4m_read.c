/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reading files: whole ones, cut ones, any layout, pipes; every prefix of a file ends in a result and never in a
 * crash. */
#include <sys/wait.h>
#include <unistd.h>

#include "../scratch.h"
#include "check.h"
#include "y4m.h"

#define WIDTH 10
#define HEIGHT 6
#define PLANES (WIDTH * HEIGHT * 3 / 2)

static char *path;

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
    *end = y4m_open(&reader, path);
    /* A damaged header may tell another size; the planes are exactly as large as it says. */
    size_t luma = (size_t)reader.header.geometry.width * (size_t)reader.header.geometry.height;
    unsigned char *picture = malloc(luma / 2 * 3 + 1);
    unsigned char *const plane[3] = {picture, picture + luma, picture + luma / 4 * 5};
    while (*end == Y4M_OK) {
        *end = y4m_read(&reader, plane, &time);
        if (*end != Y4M_OK)
            break;
        for (int j = 0; check_content && j < PLANES; j++)
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
        CHECK_EQUAL(play(&end, false), 5);
        CHECK_EQUAL(end, Y4M_END);
        write_path(bytes, size - 1);
        CHECK_EQUAL(play(&end, false), 4);
        CHECK_EQUAL(end, Y4M_BAD);
    }
}

static void test_pipe_and_rewind(void) {
    static unsigned char bytes[4096];
    struct y4m_reader reader;
    unsigned char picture[PLANES];
    unsigned char *const plane[3] = {picture, picture + WIDTH * HEIGHT, picture + WIDTH * HEIGHT / 4 * 5};
    int64_t time;
    size_t size = make(bytes, "420", PLANES, 3, true);
    write_path(bytes, size);
    CHECK_EQUAL(y4m_open(&reader, path), Y4M_OK);
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
    if (!child) { /* in dribs and drabs */
        for (size_t at = 0; at < size; at += 13)
            if (write(ends[1], bytes + at, size - at < 13 ? size - at : 13) < 0)
                _exit(1);
        _exit(0);
    }
    close(ends[1]);
    char name[32];
    snprintf(name, sizeof(name), "/dev/fd/%d", ends[0]);
    CHECK_EQUAL(y4m_open(&reader, name), Y4M_OK);
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
    CHECK_EQUAL(y4m_open(&reader, "/nonexistent/file"), Y4M_BAD);
    CHECK(strstr(reader.error, "opened"));
    y4m_close(&reader);
    CHECK_EQUAL(y4m_open(&reader, "/tmp"), Y4M_BAD);
    y4m_close(&reader);
}

int main(void) {
    scratch_make();
    path = scratch_path("clip.y4m");
    test_every_prefix(false);
    test_every_prefix(true);
    test_damage();
    test_layouts();
    test_pipe_and_rewind();
    test_no_file();
    free(path);
    return 0;
}
