/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "viewer.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "paint.h"
#include "surface.h"

/* ---- The item, and the newest picture ---- */

#define SAID_STORE 31 /* a bit beside those of enum decoder_refusal */

/* The frame's capture by this machine's monotonic clock; the wall clocks of both machines must agree. */
static struct ddxvideo_stamp stamp_of(const struct viewer *viewer, const struct assembly_frame *frame) {
    int64_t wall_offset = ddxvideo_wall_offset();
    struct ddxvideo_stamp stamp = {.time = frame->arrival, .wall_offset = wall_offset};

    if (frame->has_source) {
        stamp.frame = (int)(frame->frame.number & INT32_MAX);
        stamp.time = frame->frame.capture - wall_offset;
        stamp.source_sequence = frame->frame.sequence;
    }
    DDX_STATS stats;
    ddx_stats_get(viewer->book, &stats);
    stamp.source_lost = (int64_t)(stats.in - stats.out);
    return stamp;
}

/* Once a source: the network must not fill the log. */
static bool says_first(struct viewer *viewer, unsigned bit) {
    bool first = !(viewer->said & 1u << bit);

    viewer->said |= 1u << bit;
    return first;
}

void show_refusal(struct viewer *viewer) {
    const struct decoder *decoder = &viewer->decoder;
    char limit[80] = "";

    if (!decoder->refusal || !says_first(viewer, decoder->refusal))
        return;
    snprintf(limit, sizeof limit, "more than %" PRId64 " pixels%s", viewer->limits.pixels,
             viewer->output.name ? ", what the store can hold" : "");
    const char *why = decoder->refusal == DECODER_SIZE     ? limit
                      : decoder->refusal == DECODER_FRAMES ? "it wants too many reference frames of this size"
                      : decoder->refusal == DECODER_ODD    ? "the store needs an even width and height"
                                                           : "its samples have more than 8 bits, or it is RGB";
    if (decoder->refusal == DECODER_FORMAT)
        say("a stream that cannot be shown: %s; its frames count as lost.decode", why);
    else
        say("a stream of %dx%d that cannot be shown: %s; its frames count as lost.decode", decoder->width,
            decoder->height, why);
}

static void say_store(struct viewer *viewer, int error) {
    if (output_is_refused(error)) {
        if (says_first(viewer, SAID_STORE))
            say("%s: the store refuses the pictures: %s; trying again", viewer->output.name, ddx_error_text(error));
        return;
    }
    if (error && !viewer->said_store) /* the store hangs or restarts, and will answer again */
        say("%s: the store does not answer; trying again", viewer->output.name);
    viewer->said_store = error != 0;
}

static void count_shown(struct viewer *viewer, const struct ddxvideo_stamp *stamp, bool damaged) {
    int64_t latency = ddx_time_now() - stamp->time;

    ddx_stats_out(viewer->book, 1, latency);
    if (!viewer->print)
        return;
    printf("frame %d sequence %" PRId64 " latency_us %" PRId64 "%s\n", stamp->frame, stamp->source_sequence,
           latency / 1000, damaged ? " damaged" : "");
    fflush(stdout);
}

/* Counts the picture that waits for the screen as not shown there. */
static void drop_waiting(struct viewer *viewer, enum viewer_loss why) {
    if (viewer->newest.waits && !viewer->newest.counted)
        ddx_stats_lost(viewer->book, why, 1);
    viewer->newest.waits = false;
    av_frame_unref(viewer->newest.picture);
}

/* `counted`: the picture is counted already, since it is in the item. */
static void keep_for_screen(struct viewer *viewer, const struct ddxvideo_stamp *stamp, const AVFrame *picture,
                            bool damaged, bool counted) {
    struct newest *newest = &viewer->newest;

    drop_waiting(viewer, LOST_NEWER);
    newest->stamp = *stamp;
    newest->damaged = damaged;
    newest->counted = counted;
    newest->waits = true;
    if (av_frame_ref(newest->picture, picture))
        drop_waiting(viewer, LOST_DECODE);
}

/* At once. */
static void put_on_screen(struct viewer *viewer, const struct ddxvideo_stamp *stamp, const AVFrame *picture,
                          bool damaged, bool counted) {
    struct viewer_screen *screen = &viewer->screen;
    const char *wrong = screen->show(screen->to, picture, viewer->decoder.context->framerate, stamp);

    if (!wrong && !counted)
        count_shown(viewer, stamp, damaged);
    else if (!counted)
        ddx_stats_lost(viewer->book, LOST_DECODE, 1);
}

void show_picture(struct viewer *viewer, const struct assembly_frame *frame, const AVFrame *picture, bool damaged) {
    struct ddxvideo_stamp stamp = stamp_of(viewer, frame);
    int error = output_write(&viewer->output, viewer->id, picture, viewer->decoder.context->framerate, &stamp);
    bool written = viewer->output.name && !error;

    say_store(viewer, error);
    if (written || (!viewer->screen.show && !error))
        count_shown(viewer, &stamp, damaged);
    else if (!viewer->screen.show)
        ddx_stats_lost(viewer->book, output_is_refused(error) ? LOST_DECODE : LOST_STORE, 1);
    if (viewer->screen.each)
        put_on_screen(viewer, &stamp, picture, damaged, written);
    else if (viewer->screen.show)
        keep_for_screen(viewer, &stamp, picture, damaged, written);
}

const char *show_newest(struct viewer *viewer) {
    struct newest *newest = &viewer->newest;

    if (!newest->waits)
        return NULL;
    const char *wrong =
        viewer->screen.show(viewer->screen.to, newest->picture, viewer->decoder.context->framerate, &newest->stamp);
    if (!wrong && !newest->counted) {
        count_shown(viewer, &newest->stamp, newest->damaged);
        newest->counted = true;
    }
    drop_waiting(viewer, LOST_DECODE);
    ddx_stats_write(viewer->book);
    return wrong;
}

/* ---- The window of ddxdecode, with the latest picture ---- */

struct display {
    struct surface *surface;
    struct painter painter;
    AVFrame *picture; /* the picture on display; a size of 0: none yet */
};

/* NULL, with the reason in *error. */
static struct display *display_open(const char *title, const char **error) {
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

static const char *draw_picture(struct display *display) {
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

/* Show a picture. NULL, or the reason of a failure. */
static const char *display_show(struct display *display, const AVFrame *picture) {
    bool resized = display->picture->width != picture->width || display->picture->height != picture->height;

    av_frame_unref(display->picture);
    if (av_frame_ref(display->picture, picture))
        return "out of memory";
    if (resized)
        surface_resize(display->surface, picture->width, picture->height);
    return draw_picture(display);
}

/* False if the window was closed, or Escape or q was pressed. Call it often. */
static bool display_tick(struct display *display) {
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
        draw_picture(display);
    return open;
}

static void display_close(struct display *display) {
    if (!display)
        return;
    paint_close(&display->painter);
    surface_close(display->surface);
    av_frame_free(&display->picture);
    free(display);
}

static const char *show_on_display(void *to, const AVFrame *picture, AVRational rate,
                                   const struct ddxvideo_stamp *stamp) {
    (void)rate;
    (void)stamp;
    return display_show(to, picture);
}

static bool tick_of_display(void *to) {
    return display_tick(to);
}

void show_in_window(struct viewer *viewer) {
    const char *wrong = "neither DISPLAY nor WAYLAND_DISPLAY is set";

    /* Without a desktop SDL may write a line of its own, and then draw into memory without an error. */
    if (getenv("DISPLAY") || getenv("WAYLAND_DISPLAY") || getenv("SDL_VIDEODRIVER"))
        viewer->display = display_open(viewer->program.instance, &wrong);
    if (viewer->display)
        viewer->screen =
            (struct viewer_screen){.show = show_on_display, .tick = tick_of_display, .to = viewer->display};
    else
        say("no window is shown: %s; going on as with -headless", wrong);
}

void show_close_window(struct viewer *viewer) {
    display_close(viewer->display);
}
