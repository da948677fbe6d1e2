/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The viewer's state, and its parts. */
#ifndef DDXVIDEO_VIEW_H
#define DDXVIDEO_VIEW_H

#include "paint.h"
#include "source.h"
#include "surface.h"

#define VIEW_MS INT64_C(1000000)
#define VIEW_NS INT64_C(1000000000)

struct view {
    struct surface *surface;
    struct painter painter;
    struct source *source;
    /* for opening another item: */
    bool items; /* the source is an item */
    int store;  /* port */
    struct source_limits limits;
    /* on display: */
    struct shot *shot; /* NULL: nothing yet */
    int64_t position;  /* of the shot */
    bool paused;
    int64_t wanted;      /* position to show as soon as the source has it; -1: none */
    int64_t not_kept;    /* frames between this shot and the previous one that the history has dropped */
    int64_t begun, base; /* of a file that plays: a moment, and the time of the frame on display at that moment */
    /* settings of the display: */
    int field; /* or LAYOUT_ALL */
    enum layout_fit fit;
    struct layout_view zoom;
    bool full, help;
    struct layout fitted;        /* of the last drawing, before zooming; count 0: nothing was drawn */
    int area_width, area_height; /* of the pictures' area, above the status */
    /* pointer */
    int x, y;
    bool inside, dragging;
    /* a message */
    char message[200];
    int64_t message_until;
    /* the list of the items, a line each */
    char list[1600];
    int64_t list_until;
    /* the loop */
    bool sized; /* the window has had the size of a picture */
    bool dirty, quit;
    int64_t drawn;
    int status; /* exit status */
};

#define VIEW_MESSAGE (3 * VIEW_NS)

/* Show a message for VIEW_MESSAGE. */
__attribute__((format(printf, 2, 3))) void view_say(struct view *view, const char *format, ...);

/* Show the source's name in the window's title. */
void view_name(struct view *view);

/* Whether a live source has given no picture for long. */
bool view_is_stalled(struct view *view);

/* ---- control.c: keys and pointer, and the frame to show ---- */

/* Show the frame that is due now. */
void control_advance(struct view *view);

/* ms until the next frame of a file is due; at most `most`. */
int control_wait(struct view *view, int most);

void input_handle(struct view *view, const struct surface_event *event);

/* The list of the keys, several lines. */
const char *input_help(void);

/* ---- picture.c: the window's content ---- */

/* Draw everything. False, after a line, if the surface is gone. */
bool picture_draw(struct view *view);

/* The same, on a canvas. */
void picture_paint(struct view *view, const struct canvas *canvas);

/* The size of a window for a picture of this kind, with the status below it. */
void picture_size(const struct ddxvideo_geometry *geometry, int *width, int *height);

#endif
