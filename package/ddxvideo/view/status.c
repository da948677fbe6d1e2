/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "status.h"

#include <inttypes.h>
#include <stdio.h>
#include <time.h>

#include "range.h"
#include "text.h"

/* Green: live. Amber: paused. Red: an old picture. */
static const struct {
    const char *label;
    uint32_t colour, ink;
} states[] = {{"LIVE", 0x0c4a1c, 0xf0f0f0},
              {"PAUSED", 0xe0a000, 0x000000},
              {"PLAYING", 0x0c4a1c, 0xf0f0f0},
              {"STALLED", 0xa01818, 0xffffff},
              {"WAITING", 0x404040, 0xf0f0f0}};
enum { LIVE, PAUSED, PLAYING, STALLED, WAITING };

static int state_of(struct view *view) {
    if (view->position < 0)
        return WAITING;
    if (view->paused)
        return PAUSED;
    return !view->source->live ? PLAYING : view_is_stalled(view) ? STALLED : LIVE;
}

/* The wall time of the capture, in the user's time zone; without it, the position in the file. */
static void add_time(char *text, struct view *view) {
    const struct ddxvideo_stamp *stamp = &view->shot->picture.stamp;
    int64_t time = stamp->time + stamp->wall_offset;
    struct tm local;

    if (stamp->wall_offset) {
        time_t seconds = (time_t)(time / VIEW_NS);

        localtime_r(&seconds, &local);
    } else {
        time -= view->source->live ? 0 : view->source->time(view->source, 0);
        local = (struct tm){.tm_hour = (int)(time / VIEW_NS / 3600 % 1000), .tm_min = (int)(time / VIEW_NS / 60 % 60),
                            .tm_sec = (int)(time / VIEW_NS % 60)};
    }
    text_append(text, STATUS_MAX, "%02d:%02d:%02d.%03d", local.tm_hour, local.tm_min, local.tm_sec,
                (int)(time / VIEW_MS % 1000));
}

static void add_name(char *text, struct view *view, const struct source_state *state) {
    int64_t oldest, newest;

    view->source->range(view->source, &oldest, &newest);
    text_append(text, STATUS_MAX, "%s", view->source->name);
    if (view->shot)
        text_append(text, STATUS_MAX, "  frame %d", view->shot->picture.stamp.frame);
    if (view->position >= 0 && !view->source->live)
        text_append(text, STATUS_MAX, "  %" PRId64 "/%" PRId64 "%s", view->position + 1, newest + 1,
                    state->working ? "..." : "");
}

static void add_facts(char *text, struct view *view, const struct source_state *state) {
    int64_t oldest, newest;

    add_time(text, view);
    text_append(text, STATUS_MAX, state->rate > 0 ? "  %.1f/s" : "  -/s", state->rate);
    if (view->source->live)
        text_append(text, STATUS_MAX, "  age %.2f s", (double)(ddx_time_now() - view->shot->picture.stamp.time) / 1e9);
    text_append(text, STATUS_MAX, "  lost %" PRIu64, state->lost);
    view->source->range(view->source, &oldest, &newest);
    if (view->source->live && view->paused && newest > view->position)
        text_append(text, STATUS_MAX, "  %" PRId64 " newer", newest - view->position);
}

/* Values of the pixel under the pointer. */
static void add_pixel(char *text, struct view *view, const struct layout *layout) {
    int field, column, row;

    if (!view->inside || view->y >= view->area_height || !layout_at(layout, view->x, view->y, &field, &column, &row))
        return;
    struct paint_pixel pixel = paint_look(&view->shot->picture, field, column, row);
    if (view->shot->picture.geometry.fields > 1)
        text_append(text, STATUS_MAX, "field %d  ", field + 1);
    text_append(text, STATUS_MAX, "%d,%d  Y %d U %d V %d  RGB %d %d %d", column, row, pixel.y, pixel.u, pixel.v,
                pixel.red, pixel.green, pixel.blue);
    const struct shot_depth *depth = view->shot->depth;
    /* The fields of ddxvideoSVS: right picture, range, left picture. Disparities are those of the left one. */
    if (!depth || (view->shot->picture.geometry.fields == 3 && field == 0))
        return;
    double metres = range_metres(depth, column, row, layout->width, layout->height);
    text_append(text, STATUS_MAX, metres > 0 ? "  %.3f m" : "  range unknown", metres);
}

static void add_gap(char *text, size_t size, const struct view *view) {
    if (view->shot->missing)
        text_append(text, size, "%" PRIu64 " missing before this one", view->shot->missing);
    if (view->not_kept > 0)
        text_append(text, size, "%s%" PRId64 " not kept before this one", *text ? ", " : "", view->not_kept);
}

void status_compose(struct status *status, struct view *view, const struct layout *layout) {
    int state = state_of(view);
    struct source_state source;

    *status = (struct status){
        .label = states[state].label, .colour = states[state].colour, .ink = states[state].ink};
    view->source->state(view->source, &source);
    add_name(status->name, view, &source);
    if (view->shot) {
        add_facts(status->facts, view, &source);
        add_gap(status->gap, sizeof status->gap, view);
    }
    if (ddx_time_now() < view->message_until) {
        text_append(status->rest, STATUS_MAX, "%s", view->message);
        return;
    }
    if (view->shot && layout)
        add_pixel(status->rest, view, layout);
    if (*source.text) /* the message may stay for long, and must not hide the pixel */
        text_append(status->rest, STATUS_MAX, "%s%s", *status->rest ? "  " : "", source.text);
}
