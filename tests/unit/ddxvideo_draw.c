/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Drawing: places of fields, exact pixels, nothing outside the canvas, each character. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "image.h"
#include "paint.h"
#include "text.h"

#define GUARD 0xdeadbeefu
#define BACKGROUND 0x123456u
#define MARGIN 64 /* pixels of memory before and after the canvas, which must not change */

static struct canvas canvas_new(int width, int height, int stride) {
    size_t count = (size_t)stride * (size_t)height + 2 * MARGIN;
    uint32_t *memory = malloc(count * sizeof *memory);

    for (size_t i = 0; i < count; i++)
        memory[i] = GUARD;
    return (struct canvas){memory + MARGIN, stride, width, height};
}

static void canvas_free(struct canvas *canvas) {
    long end = (long)canvas->stride * (canvas->height - 1) + canvas->width;

    for (int i = 1; i <= MARGIN; i++)
        CHECK(canvas->pixel[-i] == GUARD);
    /* A scaler may use the padding of a wide stride, but not in the last row. */
    for (long i = end; i < (long)canvas->stride * canvas->height + MARGIN; i++)
        CHECK(canvas->pixel[i] == GUARD || i < (long)canvas->stride * canvas->height);
    free(canvas->pixel - MARGIN);
}

/* A picture with one grey for each field, 10 apart. */
static struct ddxvideo_picture picture_new(int width, int height, int fields) {
    static unsigned char luma[1 << 20], chroma[1 << 18];
    struct ddxvideo_picture picture = {
        .geometry = {.width = width, .height = height * fields, .fields = fields, .range = DDX_VIDEO_RANGE_FULL},
        .plane = {luma, chroma, chroma},
        .stride = {width, width / 2, width / 2}};

    memset(chroma, 128, sizeof chroma);
    for (int field = 0; field < fields; field++)
        memset(luma + (long)field * width * height, 10 + 10 * field, (size_t)width * (size_t)height);
    return picture;
}

static struct layout layout_of(int width, int height, int fields, int canvas_width, int canvas_height) {
    const struct ddxvideo_geometry geometry = {.width = width, .height = height * fields, .fields = fields};
    struct layout layout;

    layout_fields(&layout, &geometry, LAYOUT_ALL, LAYOUT_SHAPE, canvas_width, canvas_height);
    return layout;
}

static void test_side_by_side(void) {
    struct layout layout = layout_of(320, 240, 2, 1280, 480);
    CHECK(layout.place[0].x == 0 && layout.place[0].width == 640 && layout.place[0].height == 480);
    CHECK(layout.place[1].x == 640 && layout.place[1].y == 0);
    layout = layout_of(320, 240, 2, 320, 480);
    CHECK(layout.place[0].width == 320 && layout.place[1].x == 0 && layout.place[1].y == 240);
    layout = layout_of(100, 100, 4, 400, 400);
    CHECK(layout.place[3].x == 200 && layout.place[3].y == 200 && layout.place[3].width == 200);
}

static void test_fits(void) {
    const struct ddxvideo_geometry wide = {
        .width = 720, .height = 576, .fields = 1, .aspect_num = 16, .aspect_den = 15};
    struct layout layout;
    layout_fields(&layout, &wide, LAYOUT_ALL, LAYOUT_SHAPE, 768, 1000);
    CHECK(layout.place[0].width == 768 && layout.place[0].height == 576 && layout.place[0].y == 212);
    layout_fields(&layout, &wide, LAYOUT_ALL, LAYOUT_FILL, 640, 1000);
    CHECK(layout.place[0].width == 640 && layout.place[0].height == 1000 && !layout.exact);
    layout_fields(&layout, &wide, 7, LAYOUT_PIXELS, 640, 1000);
    CHECK(layout.place[0].width == 720 && layout.place[0].x == -40 && layout.exact && layout.place[0].field == 0);
}

/* The point under the pointer stays where it is, and zooming out far enough shows all again. */
static void test_zoom(void) {
    struct layout_view view = {1, 0, 0};
    const struct layout fitted = layout_of(64, 48, 1, 640, 480);
    for (int step = 0; step < 40; step++) {
        int field, column, row;
        layout_zoom_at(&fitted, &view, 1.25, 333, 111);
        struct layout layout = fitted;
        layout_zoom(&layout, &view);
        CHECK(layout_at(&layout, 333, 111, &field, &column, &row) && column == 33 && row == 11);
        CHECK(layout.place[0].width <= 64 * LAYOUT_LARGEST);
    }
    for (int step = 0; step < 40; step++)
        layout_zoom_at(&fitted, &view, 0.8, 0, 0);
    CHECK(view.zoom == 1 && view.x == 0 && view.y == 0);
}

static void paint(const struct canvas *canvas, const struct ddxvideo_picture *picture, const struct layout *layout) {
    struct painter painter = {0};

    CHECK_EQUAL(paint_fields(&painter, canvas, picture, layout, BACKGROUND), 0);
    paint_close(&painter);
}

/* Each size: fields at the layout's places, background around them, nothing outside the canvas. */
static void test_sizes(void) {
    for (int fields = 1; fields <= DDX_VIDEO_FIELDS; fields += 3)
        for (int width = 1; width < 200; width += 7) {
            struct ddxvideo_picture picture = picture_new(38, 22, fields);
            int height = 230 - width;
            struct canvas canvas = canvas_new(width, height, width % 2 ? width : width + 40);
            struct layout layout = layout_of(38, 22, fields, width, height);
            paint(&canvas, &picture, &layout);
            for (int y = 0; y < height; y++)
                for (int x = 0; x < width; x++) {
                    int field, column, row;
                    bool inside = layout_at(&layout, x, y, &field, &column, &row);
                    uint32_t is = canvas.pixel[y * canvas.stride + x] & 0xffffff;
                    CHECK(inside ? abs((int)(is & 255) - (10 + 10 * field)) <= 1 : is == BACKGROUND);
                }
            canvas_free(&canvas);
        }
}

static void test_exact(void) {
    static unsigned char luma[16 * 16], chroma[8 * 8];
    struct ddxvideo_picture picture = {
        .geometry = {.width = 16, .height = 16, .fields = 1}, .plane = {luma, chroma, chroma}, .stride = {16, 8, 8}};
    struct layout_view view = {1, 0, 0};
    for (int i = 0; i < 256; i++)
        luma[i] = (unsigned char)i;
    for (int i = 0; i < 64; i++)
        chroma[i] = (unsigned char)(4 * i);
    const struct layout fitted = layout_of(16, 16, 1, 101, 99);
    layout_zoom_at(&fitted, &view, 3.3, 50, 40);
    struct layout layout = fitted;
    layout_zoom(&layout, &view);
    struct canvas canvas = canvas_new(101, 99, 101);
    paint(&canvas, &picture, &layout);
    for (int y = 0; y < 99; y++)
        for (int x = 0; x < 101; x++) {
            int field, column, row;
            CHECK(layout_at(&layout, x, y, &field, &column, &row));
            struct paint_pixel pixel = paint_look(&picture, field, column, row);
            CHECK_EQUAL(pixel.y, row * 16 + column);
            CHECK_EQUAL(canvas.pixel[y * 101 + x], (unsigned)(pixel.red << 16 | pixel.green << 8 | pixel.blue));
        }
    canvas_free(&canvas);
}

/* ITU-R BT.601: black, white, and red of limited range. */
static void test_colours(void) {
    unsigned char y[4] = {16, 235, 81, 255}, u = 90, v = 240, grey = 128;
    struct ddxvideo_picture picture = {
        .geometry = {.width = 2, .height = 2, .fields = 1}, .plane = {y, &grey, &grey}, .stride = {2, 1, 1}};
    struct paint_pixel pixel = paint_look(&picture, 0, 0, 0);
    CHECK(pixel.red == 0 && pixel.green == 0 && pixel.blue == 0);
    pixel = paint_look(&picture, 0, 1, 0);
    CHECK(pixel.red == 255 && pixel.green == 255 && pixel.blue == 255);
    picture.plane[1] = &u;
    picture.plane[2] = &v;
    pixel = paint_look(&picture, 0, 0, 1);
    CHECK(abs(pixel.red - 254) <= 1 && pixel.green <= 1 && pixel.blue <= 1);
    CHECK(pixel.y == 81 && pixel.u == 90 && pixel.v == 240);
}

/* A picture whose chroma changes from sample to sample has the colours of a snapshot (libswscale) at its own size. */
static void test_snapshot(void) {
    enum { WIDTH = 96, HEIGHT = 64, CHROMA = WIDTH / 2 };
    static unsigned char y[WIDTH * HEIGHT], u[CHROMA * HEIGHT / 2], v[CHROMA * HEIGHT / 2];
    struct ddxvideo_picture picture = {
        .geometry = {.width = WIDTH, .height = HEIGHT, .fields = 1, .format = DDX_VIDEO_420},
        .plane = {y, u, v},
        .stride = {WIDTH, CHROMA, CHROMA}};
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        y[i] = (unsigned char)(90 + i % WIDTH);
    for (int i = 0; i < CHROMA * HEIGHT / 2; i++) {
        u[i] = (unsigned char)(90 + 2 * (i % CHROMA));
        v[i] = (unsigned char)(70 + 3 * (i / CHROMA));
    }
    AVFrame *image = image_new(WIDTH, HEIGHT);
    CHECK_EQUAL(image_draw(image, &picture, 0, 0, WIDTH, HEIGHT), 0);
    struct layout layout = layout_of(WIDTH, HEIGHT, 1, WIDTH, HEIGHT);
    struct canvas canvas = canvas_new(WIDTH, HEIGHT, WIDTH);
    paint(&canvas, &picture, &layout);
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        for (int channel = 0; channel < 3; channel++) {
            int taken = image->data[0][i / WIDTH * image->linesize[0] + i % WIDTH * 3 + channel];
            CHECK(abs((int)(canvas.pixel[i] >> (16 - 8 * channel) & 255) - taken) <= 1);
        }
    canvas_free(&canvas);
    av_frame_free(&image);
}

static void test_text(void) {
    uint32_t seen['~' + 1][TEXT_CELL_WIDTH * TEXT_CELL_HEIGHT];
    for (int c = ' '; c <= '~'; c++) {
        const char text[2] = {(char)c, 0};
        struct canvas canvas = canvas_new(TEXT_CELL_WIDTH, TEXT_CELL_HEIGHT, TEXT_CELL_WIDTH);
        paint_all(&canvas, 0);
        text_write(&canvas, 0, 0, 1, 1, text);
        memcpy(seen[c], canvas.pixel, sizeof seen[c]);
        for (int i = ' '; i < c; i++)
            CHECK(memcmp(seen[i], seen[c], sizeof seen[c]));
        canvas_free(&canvas);
    }
    struct canvas canvas = canvas_new(30, 30, 30); /* cut off on each side, with bytes that are no ASCII */
    for (int at = -40; at < 40; at += 3)
        text_write(&canvas, at, -at, 3, 7, "a\xc3\xa4\x01g\nnext");
    canvas_free(&canvas);
}

static void test_part(void) {
    struct canvas canvas = canvas_new(20, 10, 20), part = paint_part(&canvas, -5, 4, 10, 100);
    CHECK(part.width == 5 && part.height == 6 && part.pixel == canvas.pixel + 80);
    part = paint_part(&canvas, 30, 30, 10, 10);
    CHECK(part.width == 0 && part.height == 0);
    paint_all(&canvas, 0xff0000);
    paint_grey(&canvas);
    CHECK_EQUAL(canvas.pixel[0], 0x262626u);
    canvas_free(&canvas);
}

int main(void) {
    test_side_by_side();
    test_fits();
    test_zoom();
    test_sizes();
    test_exact();
    test_colours();
    test_snapshot();
    test_text();
    test_part();
    return 0;
}
