/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The reading side of ddxvideosave: every frame out of the store, into the ring of the present recording. */
#include "recorder.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

static const char *const reasons[] = {"store", "ring", "write", NULL};

#define KEEP_FRAMES 8
#define LOOKUP_NS INT64_C(20000000)
#define SAY_AFTER_NS INT64_C(1000000000)
#define READ_TIMEOUT 0.2 /* s; a signal does not end a wait, so look up from time to time */
#define DRAIN_FRAMES 256 /* bound on what is still taken from the store after TERM */

static void fail(struct recorder *recorder, const char *what, int error) {
    say("%s: %s", what, ddx_error_text(error));
    recorder->status = EXIT_FAILED;
    recorder->done = true;
}

/* ---- Which file ---- */

/* End a recording. When it failed, say so. */
static void finish(struct recorder *recorder, struct recording **recording) {
    if (!*recording)
        return;
    char path[PATH_MAX];
    strcpy(path, recording_path(*recording));
    int error = recording_finish(*recording);
    *recording = NULL;
    if (!error)
        return;
    say("%s: recording stopped, %s; what was recorded is readable%s", path, strerror(-error),
        error == -ENOSPC || error == -EDQUOT ? ", make room and start again" : "");
    recorder->status = EXIT_FAILED;
    recorder->done = true;
}

/* Begin a file for pictures like this one. The former file is still being written meanwhile, by its own thread. */
static void begin_file(struct recorder *recorder, const struct ddxvideo_picture *view, int64_t published) {
    if (recorder->recording) {
        finish(recorder, &recorder->former); /* a third at once would cost a third ring: wait for the oldest */
        recording_close(recorder->recording);
        recorder->former = recorder->recording;
        recorder->recording = NULL;
    }
    unsigned frames = recorder->ring_frames ? (unsigned)recorder->ring_frames : recording_ring_frames(&view->geometry);
    int error = recording_begin(&recorder->output, view, published, frames, recorder->book, &recorder->recording);
    if (error)
        fail(recorder, recorder->place, error);
    else
        say("recording %s, %dx%d, to %s", recorder->name, view->geometry.width, view->geometry.height,
            recording_path(recorder->recording));
}

static bool same_header(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b) {
    return ddxvideo_same_layout(a, b) && a->rate_num == b->rate_num && a->rate_den == b->rate_den &&
           a->aspect_num == b->aspect_num && a->aspect_den == b->aspect_den;
}

/* Make sure that the present file fits this frame. False if it cannot be recorded. */
static bool choose_file(struct recorder *recorder, const struct ddxvideo_picture *view, int64_t published) {
    if (!recorder->recording || recorder->output.is_folder) {
        if (!recorder->recording || !same_header(recording_geometry(recorder->recording), &view->geometry))
            begin_file(recorder, view, published);
        return recorder->recording != NULL;
    }
    const struct ddxvideo_geometry *now = recording_geometry(recorder->recording);
    if (!ddxvideo_same_layout(now, &view->geometry)) {
        say("%s: recording stopped, the picture changed from %dx%d to %dx%d and a file holds one kind; give -output "
            "a folder",
            recorder->place, now->width, now->height, view->geometry.width, view->geometry.height);
        recorder->status = EXIT_FAILED;
        recorder->done = true;
        return false;
    }
    if (!recorder->rate_changed && !same_header(now, &view->geometry)) {
        say("%s: frame rate or pixel aspect changed; the header keeps the first ones, the times are right",
            recorder->place);
        recorder->rate_changed = true;
    }
    return true;
}

/* ---- What was missed ---- */

static void count_missed(struct recorder *recorder, uint64_t missed, int frame) {
    ddx_stats_in(recorder->book, missed, 0);
    ddx_stats_lost(recorder->book, LOST_STORE, missed);
    int64_t first = (int64_t)recorder->frame + 1, last = (int64_t)frame - 1;
    if (last - first + 1 != (int64_t)missed)
        say("lost %" PRIu64 " frames before frame %d: gone from the store before they were read", missed, frame);
    else if (first == last)
        say("lost frame %d: gone from the store before it was read", (int)first);
    else
        say("lost frames %d to %d: gone from the store before they were read", (int)first, (int)last);
}

/*
 * Whether a frame is ours to record, before any has been: not what was written before we were told to record, and not
 * what a recorder before us has recorded. *missed: writes before it that are a loss.
 */
static bool is_wanted(struct recorder *recorder, const struct ddx_frame *frame, uint64_t *missed) {
    bool first = !recorder->seen;
    int64_t gap = ddx_stats_resume(recorder->book, frame->sequence);
    recorder->seen = true;
    if (gap > 0)
        say("lost %" PRId64 " frames while no recorder ran", gap);
    if (gap == -EALREADY || (gap < 0 && first && frame->time < recorder->begin))
        return false;
    if (gap >= 0 || first) /* counted already, or before our time */
        *missed = 0;
    return true;
}

/* ---- Frame by frame ---- */

static void handle(struct recorder *recorder, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;
    uint64_t missed = frame->missed;
    if (!recorder->delivered && !is_wanted(recorder, frame, &missed))
        return;
    int error = ddxvideo_view(recorder->video, frame->data, &view);
    if (error == -EPROTOTYPE) {
        fail(recorder, recorder->name, error);
        return;
    }
    int number = error ? (int)(recorder->frame + 1 + (int64_t)missed) : view.stamp.frame;
    recorder->delivered = true;
    if (missed)
        count_missed(recorder, missed, number);
    if (error) {
        say("lost frame %d: its numbers do not fit its memory, the program that writes it is broken", number);
        ddx_stats_in(recorder->book, 1, frame->sequence);
        ddx_stats_lost(recorder->book, LOST_STORE, 1);
    } else if (choose_file(recorder, &view, frame->time)) {
        ddx_stats_in(recorder->book, 1, frame->sequence);
        bool full = !recording_put(recorder->recording, &view, frame->time);
        if (full && !recorder->ring_full)
            say("losing frames from %d on: the ring is full, the disk is too slow", number);
        recorder->ring_full = full;
    }
    recorder->frame = number;
    ddx_stats_write(recorder->book);
}

/* The next frame, if it comes within the timeout. False if there was none. */
static bool take_frame(struct recorder *recorder, double timeout, int64_t not_after) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(recorder->video, &frame, timeout, DDX_IN_ORDER);
    if (error == -ETIMEDOUT)
        return false;
    if (error) {
        fail(recorder, recorder->name, error);
        return false;
    }
    bool wanted = frame.time <= not_after;
    if (wanted)
        handle(recorder, &frame);
    ddx_store_release(recorder->video);
    return wanted;
}

static void record(struct recorder *recorder) {
    while (!program_stopping() && !recorder->done) {
        take_frame(recorder, READ_TIMEOUT, INT64_MAX);
        program_tick(recorder->book);
        if (recorder->recording && recording_error(recorder->recording))
            recorder->done = true;
    }
    /* What was published before we were told to stop is recorded. */
    int64_t now = ddx_time_now();
    for (int i = 0; i < DRAIN_FRAMES && !recorder->done && take_frame(recorder, 0, now); i++)
        continue;
    finish(recorder, &recorder->former);
    finish(recorder, &recorder->recording);
}

/* ---- Start and end ---- */

/* Wait until somebody has created the item. False if told to stop, or failed. */
static bool find_item(struct recorder *recorder, DDX_STORE_ID *id) {
    bool said = false;
    int64_t begin = ddx_time_now();
    for (;;) {
        recorder->video = ddx_store_lookup_item(id, recorder->name, NULL, 0);
        if (recorder->video)
            break;
        if (errno != ENOENT && errno != ECONNREFUSED) {
            fail(recorder, recorder->name, -errno);
            return false;
        }
        if (!said && ddx_time_now() - begin > SAY_AFTER_NS) {
            say("waiting for %s: %s", recorder->name, ddx_error_text(-errno));
            said = true;
        }
        if (!program_sleep_until(ddx_time_now() + LOOKUP_NS, recorder->book))
            return false;
    }
    int error = -EBUSY;
    for (unsigned frames = KEEP_FRAMES; error && frames > 1; frames /= 2)
        error = ddx_store_keep(recorder->video, frames);
    if (error)
        say("%s: %s; recording with one frame of patience", recorder->name, ddx_error_text(error));
    return true;
}

int recorder_run(struct recorder *recorder) {
    recorder->begin = ddx_time_now();
    int error = output_check(&recorder->output, recorder->place, recorder->name);
    if (error) {
        say("-output %s: %s; name a file or a folder that can be written", recorder->place, strerror(-error));
        return EXIT_FAILED;
    }
    recorder->book = ddx_stats_open(recorder->program.instance, reasons);
    if (!recorder->book) {
        say("-instance %s: %s", recorder->program.instance, ddx_error_text(-errno));
        return EXIT_USAGE;
    }
    DDX_STORE_ID *id = program_connect(&recorder->program);
    if (id && !program_attach(&recorder->program, recorder->book, id, recorder->name))
        recorder->status = EXIT_FAILED;
    else if (id && find_item(recorder, id))
        record(recorder);
    ddx_stats_print(recorder->book, stdout);
    ddx_stats_close(recorder->book);
    ddx_store_done_item(recorder->video);
    ddx_store_close(id);
    return recorder->status;
}
