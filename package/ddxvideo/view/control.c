/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

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

/* ---- Keys ---- */

static void set_paused(struct view *view, bool paused) {
    view->paused = paused;
    view->dirty = true;
    view->wanted = -1;
    if (!paused)
        begin_to_play(view);
}

void control_pause(struct view *view) {
    int64_t oldest, newest;

    view->source->range(view->source, &oldest, &newest);
    set_paused(view, !view->paused);
    if (!view->paused && !view->source->live && view->position == newest)
        go(view, oldest);
}

void control_step(struct view *view, int frames) {
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
void control_seconds(struct view *view, int seconds) {
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

void control_end(struct view *view, int direction) {
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

void control_item(struct view *view, int direction) {
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
