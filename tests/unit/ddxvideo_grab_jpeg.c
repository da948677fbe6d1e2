/* SPDX-License-Identifier: GPL-2.0-or-later */
/* JPEG pictures of every kind that cameras send, compared with FFmpeg's program; damaged ones are refused. */
#include "../scratch.h"
#include "check.h"
#include "convert.h"

#define WIDTH 120 /* no multiple of a macroblock */
#define HEIGHT 88
#define LUMA (WIDTH * HEIGHT)

/* The output of a command; its size, or 0 when there is no such program. */
static size_t output_of(const char *command, unsigned char *to, size_t room) {
    FILE *pipe = popen(command, "r");
    size_t got = pipe ? fread(to, 1, room, pipe) : 0;
    int status = pipe ? pclose(pipe) : -1;
    if (WEXITSTATUS(status) == 127)
        return 0;
    CHECK_EQUAL(status, 0);
    return got;
}

static void test_kind(const char *name, const char *kind, const char *result) {
    static unsigned char jpeg[LUMA * 4], theirs[LUMA * 2], ours[LUMA * 2];
    char command[512];
    snprintf(command, sizeof(command),
             "ffmpeg -v error -nostdin -y -f lavfi -i testsrc2=size=%dx%d -frames:v 1 -vf format=%s -q:v 2 "
             "-f mjpeg %s && cat %s",
             WIDTH, HEIGHT, kind, name, name);
    size_t size = output_of(command, jpeg, sizeof(jpeg));
    if (!size)
        SKIP("no ffmpeg here to compare with");
    snprintf(command, sizeof(command),
             "ffmpeg -v error -nostdin -f mjpeg -i %s -vf scale=flags=bilinear+accurate_rnd,format=%s -f rawvideo -",
             name, result);
    size_t total = output_of(command, theirs, sizeof(theirs));
    unsigned char *const plane[3] = {ours, ours + LUMA, ours + LUMA / 4 * 5};
    const int stride[3] = {WIDTH, WIDTH / 2, WIDTH / 2};
    struct converter converter;
    const struct pixels from = {.coding = PIXELS_MJPEG, .width = WIDTH, .height = HEIGHT};
    const struct ddxvideo_geometry paper = {.width = WIDTH, .height = HEIGHT};
    CHECK_EQUAL(converter_open(&converter, &from, 0, &paper, false), 0);
    for (int again = 0; again < 3; again++) { /* a damaged picture does not affect the next */
        memset(ours, 0, sizeof(ours));
        CHECK_EQUAL(converter_run(&converter, jpeg, size, plane, stride), 0);
        CHECK(!memcmp(ours, theirs, total));
        CHECK_EQUAL(converter_run(&converter, jpeg, again, plane, stride), -74);
        CHECK_EQUAL(converter_run(&converter, jpeg, size / 2, plane, stride), -74);
        CHECK_EQUAL(converter_run(&converter, theirs, size, plane, stride), -74);
    }
    if (total == LUMA) /* grey */
        CHECK(ours[LUMA] == 128 && ours[LUMA / 2 * 3 - 1] == 128);
    converter_close(&converter);
    /* not the agreed size */
    const struct pixels other = {.coding = PIXELS_JPEG, .width = WIDTH - 2, .height = HEIGHT};
    CHECK_EQUAL(converter_open(&converter, &other, 0, &paper, false), 0);
    CHECK_EQUAL(converter_run(&converter, jpeg, size, plane, stride), -74);
    converter_close(&converter);
}

int main(void) {
    scratch_make();
    char *name = scratch_path("picture.jpeg");
    test_kind(name, "yuvj420p", "yuvj420p");
    test_kind(name, "yuvj422p", "yuvj420p");
    test_kind(name, "yuvj444p", "yuvj420p");
    test_kind(name, "gray", "gray");
    free(name);
    return 0;
}
