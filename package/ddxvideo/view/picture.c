/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "program.h"
#include "range.h"
#include "text.h"

#define STATUS_MAX 300

/* The three lines below the pictures. */
struct status {
    const char *label; /* LIVE, PAUSED, ... */
    uint32_t colour, ink;
    char name[STATUS_MAX], gap[80], facts[STATUS_MAX], rest[STATUS_MAX];
};

/* ---- The lines below the pictures ---- */

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
        local = (struct tm){.tm_hour = (int)(time / VIEW_NS / 3600 % 1000),
                            .tm_min = (int)(time / VIEW_NS / 60 % 60),
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

/* Write the lines. `layout`: as drawn, zoomed; NULL: nothing is drawn. */
static void status_compose(struct status *status, struct view *view, const struct layout *layout) {
    int state = state_of(view);
    struct source_state source;

    *status = (struct status){.label = states[state].label, .colour = states[state].colour, .ink = states[state].ink};
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

/* ---- Pictures ---- */

#define BACKGROUND 0x181818
#define HELP_COLOUR 0x10243c
#define ITEMS_COLOUR 0x2c1040
#define GAP_COLOUR 0xa01818
#define WHITE 0xf0f0f0
#define LINE 52         /* characters that a line must hold */
#define PAD 3           /* around a line of text, times the scale */
#define LEAST_WIDTH 640 /* of a window: the least for the status */
#define MOST_WIDTH 1280 /* fits on most screens */
#define MOST_HEIGHT 900

/* The text's scale: the largest at which its lines fit. */
static int scale_of(int width, int height) {
    int scale = text_scale(height), most = width / (LINE * TEXT_CELL_WIDTH);

    return scale <= most ? scale : most > 1 ? most : 1;
}

static int bar_height(int scale) {
    return 3 * (TEXT_CELL_HEIGHT + PAD) * scale;
}

void picture_size(const struct ddxvideo_geometry *geometry, int *width, int *height) {
    struct layout layout;
    double wide, high, factor = 1;

    layout_square(geometry, &wide, &high);
    layout_fields(&layout, geometry, LAYOUT_ALL, LAYOUT_SHAPE, MOST_WIDTH, MOST_HEIGHT);
    int columns = 1;
    for (int i = 1; i < layout.count; i++)
        columns += layout.place[i].y == layout.place[0].y;
    wide *= columns;
    high *= (double)((layout.count + columns - 1) / columns);
    while (wide * factor < LEAST_WIDTH)
        factor++;
    if (wide * factor > MOST_WIDTH)
        factor = MOST_WIDTH / wide;
    if (high * factor > MOST_HEIGHT)
        factor = MOST_HEIGHT / high;
    *width = (int)(wide * factor + 0.5);
    *height = (int)(high * factor + 0.5);
    *width = *width < LEAST_WIDTH / 2 ? LEAST_WIDTH / 2 : *width;
    *height = *height < 16 ? 16 : *height;
    *height += bar_height(scale_of(*width, *height + bar_height(scale_of(*width, *height))));
}

static int width_of(const char *text, int letters, int scale) {
    return (int)strlen(text) * TEXT_CELL_WIDTH * letters + 2 * PAD * scale;
}

/* Draws text on a background of its own, smaller if it is too long. Returns the width. */
static int write_on(const struct canvas *canvas, int x, int y, int scale, uint32_t ground, uint32_t ink,
                    const char *text) {
    int letters = scale;

    while (letters > 1 && x + width_of(text, letters, scale) > canvas->width)
        letters--;
    int width = width_of(text, letters, scale);
    struct canvas part = paint_part(canvas, x, y, width, (TEXT_CELL_HEIGHT + PAD) * scale);

    paint_all(&part, ground);
    text_write(canvas, x + PAD * scale, y + PAD * scale / 2 + scale / 2, letters, ink, text);
    return width;
}

static void draw_status(const struct canvas *canvas, const struct status *status, int top, int scale) {
    struct canvas bar = paint_part(canvas, 0, top, canvas->width, canvas->height - top);
    int line = (TEXT_CELL_HEIGHT + PAD) * scale, x = 0;

    paint_all(&bar, status->colour);
    x = write_on(&bar, 0, 0, scale, status->ink, status->colour, status->label);
    if (*status->gap) /* before the name, which can be long */
        x += write_on(&bar, x, 0, scale, GAP_COLOUR, WHITE, status->gap);
    write_on(&bar, x, 0, scale, status->colour, status->ink, status->name);
    write_on(&bar, 0, line, scale, status->colour, status->ink, status->facts);
    write_on(&bar, 0, 2 * line, scale, status->colour, status->ink, status->rest);
}

/* ---- The lists of the keys and of the items ---- */

static void draw_list(const struct canvas *canvas, int scale, uint32_t colour, const char *text) {
    int lines = 1, longest = 0, length = 0;

    for (const char *c = text; *c; c++) {
        length = *c == '\n' ? 0 : length + 1;
        longest = length > longest ? length : longest;
        lines += *c == '\n';
    }
    while (scale > 1 &&
           (lines * TEXT_CELL_HEIGHT * scale > canvas->height || longest * TEXT_CELL_WIDTH * scale > canvas->width))
        scale--;
    int width = (longest + 4) * TEXT_CELL_WIDTH * scale, height = (lines + 1) * TEXT_CELL_HEIGHT * scale;
    int x = (canvas->width - width) / 2, y = (canvas->height - height) / 2;
    x = x < 0 ? 0 : x;
    y = y < 0 ? 0 : y;
    struct canvas panel = paint_part(canvas, x, y, width, height);
    paint_all(&panel, colour);
    text_write(&panel, 2 * TEXT_CELL_WIDTH * scale, TEXT_CELL_HEIGHT * scale / 2, scale, WHITE, text);
}

/* ---- All ---- */

/* Draws the fields, zoomed. */
static bool draw_fields(struct view *view, const struct canvas *area, struct layout *layout) {
    layout_fields(&view->fitted, &view->shot->picture.geometry, view->field, view->fit, area->width, area->height);
    *layout = view->fitted;
    layout_zoom(layout, &view->zoom);
    return !paint_fields(&view->painter, area, &view->shot->picture, layout, BACKGROUND);
}

void picture_paint(struct view *view, const struct canvas *canvas) {
    int scale = scale_of(canvas->width, canvas->height), top = canvas->height - bar_height(scale);
    struct canvas area = paint_part(canvas, 0, 0, canvas->width, top < 0 ? 0 : top);
    struct layout layout;
    struct status status;
    bool shown = view->shot && area.height > 0;

    view->area_width = area.width;
    view->area_height = area.height;
    if (shown)
        draw_fields(view, &area, &layout);
    else
        paint_all(&area, BACKGROUND);
    status_compose(&status, view, shown ? &layout : NULL);
    if (view->help)
        draw_list(&area, scale, HELP_COLOUR, input_help());
    else if (ddx_time_now() < view->list_until)
        draw_list(&area, scale, ITEMS_COLOUR, view->list);
    draw_status(canvas, &status, area.height, scale);
}

bool picture_draw(struct view *view) {
    struct canvas canvas;
    const char *wrong = surface_lock(view->surface, &canvas);

    if (!wrong) {
        picture_paint(view, &canvas);
        wrong = surface_show(view->surface);
    }
    if (wrong)
        say("nothing can be shown: %s", wrong);
    view->dirty = false;
    view->drawn = ddx_time_now();
    return !wrong;
}
