/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "show.h"

#include <inttypes.h>
#include <stdio.h>

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
static void pass_over(struct viewer *viewer, enum viewer_loss why) {
    if (viewer->newest.waits && !viewer->newest.counted)
        ddx_stats_lost(viewer->book, why, 1);
    viewer->newest.waits = false;
    av_frame_unref(viewer->newest.picture);
}

/* `counted`: the picture is counted already, since it is in the item. */
static void keep_for_screen(struct viewer *viewer, const struct ddxvideo_stamp *stamp, const AVFrame *picture,
                            bool damaged, bool counted) {
    struct newest *newest = &viewer->newest;

    pass_over(viewer, LOST_NEWER);
    newest->stamp = *stamp;
    newest->damaged = damaged;
    newest->counted = counted;
    newest->waits = true;
    if (av_frame_ref(newest->picture, picture))
        pass_over(viewer, LOST_DECODE);
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
    pass_over(viewer, LOST_DECODE);
    ddx_stats_write(viewer->book);
    return wrong;
}
