/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The time of ddxvideoview for a frame, beside the same sws_scale() alone: VGA to 1024x768, both drawn into memory. A
 * frame is copied out of the store, drawn, and gets its status below it. view [FRAMES]; prints one line of JSON.
 */
#include <libavutil/pixfmt.h>
#include <libswscale/swscale.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "view.h"

#define WIDTH 640
#define HEIGHT 480
#define WIDE 1024
#define HIGH 768
#define BAR 78
#define ROUND 10 /* frames of each by turns */

static unsigned char luma[WIDTH * HEIGHT], chroma[WIDTH * HEIGHT / 4];
static uint32_t pixels[WIDE * (HIGH + BAR) + 64];

const char *input_help(void) {
    return "";
}

bool view_is_stalled(struct view *view) {
    (void)view;
    return false;
}

static void range(struct source *source, int64_t *oldest, int64_t *newest) {
    (void)source;
    *oldest = *newest = 0;
}

static int64_t when(struct source *source, int64_t position) {
    (void)source;
    (void)position;
    return 0;
}

static void state(struct source *source, struct source_state *state) {
    (void)source;
    *state = (struct source_state){.rate = 25};
}

static double cpu(void) {
    struct timespec now;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
}

static double ours(struct view *view, struct shot_pool *pool, const struct ddxvideo_picture *picture) {
    const struct canvas canvas = {pixels, WIDE, WIDE, HIGH + BAR};
    double begin = cpu();

    for (int i = 0; i < ROUND; i++) {
        shot_drop(view->shot);
        view->shot = shot_copy(pool, picture);
        picture_paint(view, &canvas);
    }
    return cpu() - begin;
}

static double alone(struct SwsContext *scaler, const struct ddxvideo_picture *picture) {
    uint8_t *to[4] = {(uint8_t *)pixels};
    const int stride[4] = {WIDE * (int)sizeof *pixels};
    double begin = cpu();

    for (int i = 0; i < ROUND; i++)
        sws_scale(scaler, picture->plane, picture->stride, 0, HEIGHT, to, stride);
    return cpu() - begin;
}

int main(int argc, char **argv) {
    int frames = argc > 1 ? atoi(argv[1]) : 500;
    struct source source = {.live = true, .name = "video", .range = range, .time = when, .state = state};
    struct view view = {.source = &source, .field = LAYOUT_ALL, .zoom = {1, 0, 0}};
    const struct ddxvideo_picture picture = {.geometry = {.width = WIDTH, .height = HEIGHT, .fields = 1},
                                             .plane = {luma, chroma, chroma},
                                             .stride = {WIDTH, WIDTH / 2, WIDTH / 2},
                                             .rows = {HEIGHT, HEIGHT / 2, HEIGHT / 2}};
    struct SwsContext *scaler = sws_getContext(WIDTH, HEIGHT, AV_PIX_FMT_YUV420P, WIDE, HIGH, AV_PIX_FMT_0RGB32,
                                               SWS_BILINEAR, NULL, NULL, NULL);
    struct shot_pool pool;
    double viewer = 0, scale = 0;

    for (int i = 0; i < WIDTH * HEIGHT; i++)
        luma[i] = (unsigned char)(i * 7 + i / WIDTH);
    memset(chroma, 100, sizeof chroma);
    shot_pool_open(&pool, UINT64_MAX);
    ours(&view, &pool, &picture);
    alone(scaler, &picture);
    for (int i = 0; i < frames; i += ROUND) {
        viewer += ours(&view, &pool, &picture);
        scale += alone(scaler, &picture);
    }
    frames = (frames + ROUND - 1) / ROUND * ROUND;
    printf("{\"frames\": %d, \"viewer_us\": %.1f, \"sws_scale_us\": %.1f, \"ratio\": %.3f}\n", frames,
           viewer * 1e6 / frames, scale * 1e6 / frames, viewer / scale);
    shot_drop(view.shot);
    shot_pool_close(&pool);
    paint_close(&view.painter);
    sws_freeContext(scaler);
    return 0;
}
