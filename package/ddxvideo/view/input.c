/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "image.h"
#include "program.h"

/* ---- Save ---- */

#define NAMES 1000 /* of one frame */

/* A name that no file has yet. */
static void choose_name(const struct view *view, char *path, size_t size) {
    const char *name = view->source->name;
    int frame = view->shot->picture.stamp.frame;

    snprintf(path, size, "./%s-%06d.png", name, frame);
    for (int i = 2; i < NAMES && !access(path, F_OK); i++)
        snprintf(path, size, "./%s-%06d-%d.png", name, frame, i);
}

static int save_as(const struct ddxvideo_picture *picture, const char *path) {
    const struct ddxvideo_geometry *geometry = &picture->geometry;
    AVFrame *image = image_new(geometry->width, geometry->height);
    int error = image ? image_draw(image, picture, 0, 0, geometry->width, geometry->height) : -ENOMEM;

    if (!error)
        error = image_save(image, IMAGE_PNG, path);
    av_frame_free(&image);
    return error;
}

/*
 * Write into the current folder `video-000123.png`, or `video-000123-2.png` if that file exists: all pixels of all
 * fields, even if some are not on display. A message has the file's name or the error.
 */
static void save_shot(struct view *view) {
    char path[200];

    if (!view->shot) {
        view_say(view, "there is no frame to save");
        return;
    }
    choose_name(view, path, sizeof path);
    int error = save_as(&view->shot->picture, path);
    if (error) {
        view_say(view, "%s: %s", path + 2, strerror(-error));
        say("%s: %s", path + 2, strerror(-error));
    } else {
        view_say(view, "saved %s", path + 2);
    }
}

#define WHEEL 1.25 /* factor of one step of the wheel */

static void help(struct view *view, int number) {
    (void)number;
    view->help = !view->help;
}

struct key {
    int key;
    const char *name, *help;
    void (*act)(struct view *view, int number);
    int number;
};

static void pause_it(struct view *view, int number) {
    (void)number;
    control_pause(view);
}

static void save(struct view *view, int number) {
    (void)number;
    save_shot(view);
}

static void quit(struct view *view, int number) {
    (void)number;
    view->quit = true;
}

static void full(struct view *view, int number) {
    bool wanted = number && !view->full;

    if (wanted != view->full)
        surface_full(view->surface, wanted);
    view->full = wanted;
}

static void zoom(struct view *view, const struct surface_event *event) {
    if (view->fitted.count)
        layout_zoom_at(&view->fitted, &view->zoom, pow(WHEEL, event->steps), event->x, event->y);
    view->dirty = true;
}

static void set_fit(struct view *view, enum layout_fit fit) {
    view->fit = fit;
    view->zoom = (struct layout_view){1, 0, 0};
}

static void one_to_one(struct view *view, int number) {
    (void)number;
    set_fit(view, view->fit == LAYOUT_PIXELS && view->zoom.zoom == 1 ? LAYOUT_SHAPE : LAYOUT_PIXELS);
}

static void field(struct view *view, int number) {
    if (number > 0 && view->shot && number > view->shot->picture.geometry.fields) {
        view_say(view, "there is no field %d", number);
        return;
    }
    view->field = number ? number - 1 : LAYOUT_ALL;
    set_fit(view, view->fit);
}

static const struct key keys[] = {
    {' ', "Space", "pause, go on", pause_it, 0},
    {'.', ".", "pause, one frame forward", control_step, 1},
    {',', ",", "pause, one frame back", control_step, -1},
    {SURFACE_RIGHT, "Right", "a second forward", control_seconds, 1},
    {SURFACE_LEFT, "Left", "a second back", control_seconds, -1},
    {SURFACE_UP, "Up", "a minute forward", control_seconds, 60},
    {SURFACE_DOWN, "Down", "a minute back", control_seconds, -60},
    {SURFACE_HOME, "Home", "oldest frame", control_end, -1},
    {SURFACE_END, "End", "newest frame", control_end, 1},
    {'s', "s", "save the frame as PNG", save, 0},
    {'f', "f", "full screen", full, 1},
    {SURFACE_ESCAPE, "Escape", "leave full screen", full, 0},
    {'z', "z", "one pixel each; again: fit", one_to_one, 0},
    {'n', "n", "next item", control_item, 1},
    {'p', "p", "previous item", control_item, -1},
    {'q', "q", "quit", quit, 0},
    {'?', "?", "this list", help, 0},
};
#define KEYS (sizeof keys / sizeof *keys)

const char *input_help(void) {
    static char text[1000];
    size_t length = 0;

    if (*text)
        return text;
    for (size_t i = 0; i < KEYS; i++)
        length += (size_t)snprintf(text + length, sizeof text - length, "%-8s %s\n", keys[i].name, keys[i].help);
    snprintf(text + length, sizeof text - length,
             "1 to 9   one field; 0: all\nwheel    zoom at the pointer\n"
             "drag     move the picture");
    return text;
}

static void press(struct view *view, int key) {
    if (key >= '0' && key <= '9')
        field(view, key - '0');
    for (size_t i = 0; i < KEYS; i++)
        if (keys[i].key == key)
            keys[i].act(view, keys[i].number);
    view->dirty = true;
}

/* ---- Pointer ---- */

static double between(double value, double least, double most) {
    return value < least ? least : value > most ? most : value;
}

/* The middle of the window must stay within the pictures. */
static void keep_in_sight(struct view *view) {
    view->zoom.x =
        between(view->zoom.x, view->area_width / 2.0 - view->area_width * view->zoom.zoom, view->area_width / 2.0);
    view->zoom.y =
        between(view->zoom.y, view->area_height / 2.0 - view->area_height * view->zoom.zoom, view->area_height / 2.0);
}

static void point(struct view *view, const struct surface_event *event) {
    if (view->dragging && event->held) {
        view->zoom.x += event->x - view->x;
        view->zoom.y += event->y - view->y;
        keep_in_sight(view);
    }
    view->x = event->x;
    view->y = event->y;
    view->inside = true;
    view->dirty = true;
}

void input_handle(struct view *view, const struct surface_event *event) {
    switch (event->kind) {
    case SURFACE_KEY: press(view, event->key); break;
    case SURFACE_POINTER: point(view, event); break;
    case SURFACE_BUTTON:
        view->dragging = event->held;
        point(view, event);
        break;
    case SURFACE_WHEEL: zoom(view, event); break;
    case SURFACE_RESIZE: view->dirty = true; break;
    case SURFACE_CLOSE: view->quit = true; break;
    case SURFACE_WAKE: break;
    }
}
