/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "input.h"

#include <math.h>
#include <stdio.h>

#include "control.h"
#include "save.h"

#define WHEEL 1.25 /* factor of one step of the wheel */

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

static void help(struct view *view, int number) {
    (void)number;
    view->help = !view->help;
}

static void full(struct view *view, int number) {
    bool wanted = number && !view->full;

    if (wanted != view->full)
        surface_full(view->surface, wanted);
    view->full = wanted;
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
    snprintf(text + length, sizeof text - length, "1 to 9   one field; 0: all\nwheel    zoom at the pointer\n"
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
    view->zoom.x = between(view->zoom.x, view->area_width / 2.0 - view->area_width * view->zoom.zoom,
                           view->area_width / 2.0);
    view->zoom.y = between(view->zoom.y, view->area_height / 2.0 - view->area_height * view->zoom.zoom,
                           view->area_height / 2.0);
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

static void zoom(struct view *view, const struct surface_event *event) {
    if (view->fitted.count)
        layout_zoom_at(&view->fitted, &view->zoom, pow(WHEEL, event->steps), event->x, event->y);
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
