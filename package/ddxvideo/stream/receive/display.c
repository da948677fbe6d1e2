/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "display.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "output.h"
#include "paint.h"
#include "window.h"

struct display {
    struct surface *surface;
    struct painter painter;
    AVFrame *picture; /* the picture on display; a size of 0: none yet */
};

struct display *display_open(const char *title, const char **error) {
    struct display *display = calloc(1, sizeof *display);

    *error = "out of memory";
    if (!display)
        return NULL;
    display->picture = av_frame_alloc();
    if (display->picture)
        display->surface = window_open(title, error);
    if (display->surface)
        return display;
    av_frame_free(&display->picture);
    free(display);
    return NULL;
}

static const char *draw(struct display *display) {
    const struct ddxvideo_picture picture = output_picture(display->picture, (AVRational){0, 0});
    struct canvas canvas;
    struct layout layout;
    const char *wrong = surface_lock(display->surface, &canvas);

    if (wrong)
        return wrong;
    layout_fields(&layout, &picture.geometry, LAYOUT_ALL, LAYOUT_SHAPE, canvas.width, canvas.height);
    int error = paint_fields(&display->painter, &canvas, &picture, &layout, 0);
    wrong = surface_show(display->surface);
    return error ? strerror(-error) : wrong;
}

const char *display_show(struct display *display, const AVFrame *picture) {
    bool resized = display->picture->width != picture->width || display->picture->height != picture->height;

    av_frame_unref(display->picture);
    if (av_frame_ref(display->picture, picture))
        return "out of memory";
    if (resized)
        surface_resize(display->surface, picture->width, picture->height);
    return draw(display);
}

bool display_tick(struct display *display) {
    struct surface_event event;
    bool open = true, again = false;

    while (surface_event(display->surface, &event, 0)) {
        if (event.kind == SURFACE_CLOSE)
            open = false;
        if (event.kind == SURFACE_KEY)
            open &= event.key != SURFACE_ESCAPE && event.key != 'q';
        again |= event.kind == SURFACE_RESIZE;
    }
    if (open && again && display->picture->width)
        draw(display);
    return open;
}

void display_close(struct display *display) {
    if (!display)
        return;
    paint_close(&display->painter);
    surface_close(display->surface);
    av_frame_free(&display->picture);
    free(display);
}
