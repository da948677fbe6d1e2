/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view_run.h"

#include "control.h"
#include "input.h"
#include "picture.h"
#include "program.h"

#define REFRESH (250 * VIEW_MS) /* between updates of ages and counts while no picture comes */
#define LOOK 100                /* ms, between checks for a stop */

static bool has_size(struct surface *surface, int width, int height) {
    int is_width, is_height;

    surface_size(surface, &is_width, &is_height);
    return is_width == width && is_height == height;
}

/* Gives the window the first picture's size. Until then it has the size of CIF, or the user's choice. */
static void open_window(struct view *view, bool *open) {
    const struct ddxvideo_geometry cif = {.width = 352, .height = 288, .fields = 1};
    int width, height, former_width, former_height;

    if (view->sized || (*open && !view->shot))
        return;
    view->sized = view->shot;
    picture_size(&cif, &former_width, &former_height);
    if (*open && !has_size(view->surface, former_width, former_height))
        return;
    picture_size(view->shot ? &view->shot->picture.geometry : &cif, &width, &height);
    if (!*open)
        view_name(view);
    if (!*open || width != former_width || height != former_height)
        surface_resize(view->surface, width, height);
    view->dirty = *open = true;
}

/* Time until the display changes without an event, ms. */
static int wait_for(struct view *view) {
    struct source_state state;

    view->source->state(view->source, &state);
    if (state.working)
        return view->dirty ? 0 : 1;
    return control_wait(view, LOOK);
}

static void take_events(struct view *view, int timeout) {
    struct surface_event event;

    while (!view->quit && surface_event(view->surface, &event, timeout)) {
        input_handle(view, &event);
        timeout = 0;
    }
}

static void check_source(struct view *view) {
    struct source_state state;

    view->source->work(view->source);
    view->source->state(view->source, &state);
    if (state.failed) {
        view->status = EXIT_FAILED;
        view->quit = true;
    }
}

int view_run(struct view *view) {
    bool open = false;
    int64_t opened = ddx_time_now() + REFRESH; /* if the first picture comes soon, the window appears with its size */

    while (!view->quit && !program_stopping()) {
        check_source(view);
        control_advance(view);
        if (view->shot || ddx_time_now() > opened)
            open_window(view, &open);
        if (ddx_time_now() - view->drawn > REFRESH)
            view->dirty = true;
        if (open && view->dirty && !view->quit && !picture_draw(view)) {
            view->status = EXIT_FAILED;
            break;
        }
        take_events(view, wait_for(view));
    }
    shot_drop(view->shot);
    view->source->close(view->source);
    paint_close(&view->painter);
    return view->status;
}
