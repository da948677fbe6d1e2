/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "image.h"
#include "program.h"
#include "text.h"

/* ---- A frame ---- */

/* If a file's frame cannot be read, the window is empty, and the status has the reason. */
static void show(struct view *view, int64_t position) {
    struct shot *shot = view->source->take(view->source, position);

    if (!shot && view->source->live) /* a newer frame has just taken its memory */
        return;
    shot_drop(view->shot);
    view->shot = shot;
    view->position = position;
    view->not_kept = 0;
    view->dirty = true;
}

/* A file continues from the frame on display. */
static void begin_to_play(struct view *view) {
    view->begun = ddx_time_now();
    view->base = view->source->time(view->source, view->position);
}

static bool is_working(struct view *view) {
    struct source_state state;

    view->source->state(view->source, &state);
    return state.working;
}

/* A position, or the nearest existing one. */
static void go(struct view *view, int64_t position) {
    int64_t oldest, newest, former = view->position;

    view->source->range(view->source, &oldest, &newest);
    if (newest < oldest)
        return;
    int64_t to = position < oldest ? oldest : position > newest ? newest : position;
    if (position > newest && is_working(view)) /* a large file is searched in steps */
        view->wanted = position;
    if (to == former)
        return;
    show(view, to);
    if (position == former + 1)
        view->not_kept = to - position;
    begin_to_play(view);
}

/* ---- Steps ---- */

static void set_paused(struct view *view, bool paused) {
    view->paused = paused;
    view->dirty = true;
    view->wanted = -1;
    if (!paused)
        begin_to_play(view);
}

static void control_pause(struct view *view) {
    int64_t oldest, newest;

    view->source->range(view->source, &oldest, &newest);
    set_paused(view, !view->paused);
    if (!view->paused && !view->source->live && view->position == newest)
        go(view, oldest);
}

/* Pause, and step by this number of frames, forward or back. */
static void control_step(struct view *view, int frames) {
    int64_t oldest, newest, before = view->position;

    set_paused(view, true);
    view->source->range(view->source, &oldest, &newest);
    if (before < 0)
        return;
    if (frames > 0 || before > oldest) /* a frame that was dropped since also counts as the oldest */
        go(view, before + frames);
    if (view->position == before && view->wanted < 0)
        view_say(view, frames < 0 ? "this is the oldest frame" : "this is the newest frame");
}

/* The frame at this distance in time, by the times of the frames. */
static void control_seconds(struct view *view, int seconds) {
    int64_t oldest, newest, to = view->position;

    view->source->range(view->source, &oldest, &newest);
    if (newest < oldest || to < 0)
        return;
    if (view->source->live)
        set_paused(view, true);
    to = to < oldest ? oldest : to;
    int64_t wanted = view->source->time(view->source, to) + seconds * VIEW_NS;
    while (seconds < 0 && to > oldest && view->source->time(view->source, to) > wanted)
        to--;
    while (seconds > 0 && to < newest && view->source->time(view->source, to) < wanted)
        to++;
    go(view, to);
}

/* Go to the oldest (-1) or the newest (1) frame. */
static void control_end(struct view *view, int direction) {
    if (view->source->live && direction < 0)
        set_paused(view, true);
    go(view, direction < 0 ? 0 : INT64_MAX);
}

/* ---- Items ---- */

#define LINES 16 /* of the list */

static bool is_shown(const struct ddx_item_info *item) {
    return !strcmp(item->type, "DDX_VIDEO") && item->sequence;
}

/* The next item in the order of names; the first follows the last. NULL: there is no other. */
static const char *other_item(const struct ddx_item_info *items, unsigned count, const char *name, int direction) {
    unsigned at = 0;

    while (at < count && strcmp(items[at].name, name) < 0)
        at++;
    bool there = at < count && !strcmp(items[at].name, name);
    if (!there && direction > 0)
        at += count - 1;
    for (unsigned i = 1; i <= count; i++) {
        unsigned other = (at + count * i + (direction > 0 ? i : count - i)) % count;

        if (is_shown(&items[other]) && strcmp(items[other].name, name))
            return items[other].name;
    }
    return NULL;
}

static void open_item(struct view *view, const char *name) {
    struct source *other = source_item(name, view->store, &view->limits, view->surface);

    if (!other) {
        view_say(view, "out of memory");
        return;
    }
    shot_drop(view->shot);
    view->shot = NULL;
    view->source->close(view->source);
    view->source = other;
    view_name(view);
    view->position = -1;
    view->zoom = (struct layout_view){1, 0, 0};
    set_paused(view, false);
}

/* Shows the items around the current one, which is marked, for as long as a message. */
static void list_items(struct view *view, const struct ddx_item_info *items, unsigned count) {
    unsigned shown = 0, at = 0, number = 0;

    for (unsigned i = 0; i < count; i++) {
        at = strcmp(items[i].name, view->source->name) ? at : shown;
        shown += is_shown(&items[i]);
    }
    unsigned first = at > LINES / 2 ? at - LINES / 2 : 0;
    first = first + LINES > shown && shown > LINES ? shown - LINES : first;
    *view->list = 0;
    for (unsigned i = 0; i < count; i++) {
        if (!is_shown(&items[i]))
            continue;
        if (number >= first && number < first + LINES)
            text_append(view->list, sizeof view->list, "%s%c %s", number > first ? "\n" : "", number == at ? '>' : ' ',
                        items[i].name);
        number++;
    }
    if (shown > LINES)
        text_append(view->list, sizeof view->list, "\n  %u of %u", at + 1, shown);
    view->list_until = ddx_time_now() + VIEW_MESSAGE;
}

/* Open the next (1) or previous (-1) video item of the store. */
static void control_item(struct view *view, int direction) {
    DDX_STORE_ID *id = view->items ? ddx_store_open(NULL, view->store, 0) : NULL;
    struct ddx_item_info *items;
    unsigned count;

    if (!id || ddx_store_list(id, NULL, &items, &count)) {
        view_say(view, view->items ? "there is no store" : "there is no other item");
        ddx_store_close(id);
        return;
    }
    const char *name = count ? other_item(items, count, view->source->name, direction) : NULL;
    if (name) {
        open_item(view, name);
        list_items(view, items, count);
    } else {
        view_say(view, "the store has no other video item");
    }
    free(items);
    ddx_store_close(id);
}

/* ---- Time ---- */

/* The time at which to show a frame of the file. */
static int64_t due(struct view *view, int64_t position) {
    return view->begun + view->source->time(view->source, position) - view->base;
}

/* The newest frame that is due; earlier frames that were not shown in time are skipped. */
static void play_file(struct view *view, int64_t newest) {
    int64_t to = view->position, now = ddx_time_now();

    while (to < newest && due(view, to + 1) <= now)
        to++;
    if (to != view->position)
        show(view, to);
    if (to == newest && !is_working(view)) {
        view->paused = true;
        view->dirty = true;
    }
}

static void go_on_to_wanted(struct view *view) {
    int64_t wanted = view->wanted;

    view->wanted = -1;
    go(view, wanted);
}

void control_advance(struct view *view) {
    int64_t oldest, newest;

    view->source->range(view->source, &oldest, &newest);
    if (newest < oldest)
        return;
    if (view->wanted >= 0)
        go_on_to_wanted(view);
    if (view->position < 0) {
        show(view, view->source->live ? newest : oldest);
        begin_to_play(view);
    } else if (!view->paused && view->source->live && view->position < newest) {
        show(view, newest);
    } else if (!view->paused && !view->source->live) {
        play_file(view, newest);
    }
}

int control_wait(struct view *view, int most) {
    int64_t oldest, newest;

    view->source->range(view->source, &oldest, &newest);
    if (view->paused || view->source->live || view->position >= newest)
        return most;
    int64_t ms = (due(view, view->position + 1) - ddx_time_now() + VIEW_MS - 1) / VIEW_MS;
    return ms < 1 ? 1 : ms > most ? most : (int)ms;
}

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

/* ---- What the keys do ---- */

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
