/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Puts each frame of the store into the queue of the current recording, and counts those missed between them. */
#include "recorder_frames.h"

#include <errno.h>
#include <inttypes.h>

#include "recorder_file.h"
#include "y4m.h"

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

/* Takes over the geometry, and chooses the frames that are wanted. */
static void look(struct recorder *recorder, struct ddxvideo_picture *view) {
    if (decimate_look(&recorder->decimate, &view->geometry) && !recorder->rate_unknown) {
        say("%s: its rate is unknown, so each frame is recorded; -skip N takes one of N",
            recorder->name);
        recorder->rate_unknown = true;
    }
    recorder->geometry = view->geometry;
}

static uint64_t wanted_up_to(const void *decimate, uint64_t sequence) {
    return decimate_up_to(decimate, sequence);
}

/*
 * After the first read, which may have returned a frame: this recorder accounts for all later frames, and for earlier
 * ones that a predecessor left when it died. Of an item that did not exist before, it accounts for all frames from the
 * first write on, whenever the store began to keep frames.
 */
void recorder_follow(struct recorder *recorder, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;

    if (frame && !ddxvideo_view_any(recorder->video, frame->data, &view))
        look(recorder, &view);
    uint64_t seen = ddx_store_seen(recorder->video);
    uint64_t from = frame ? seen - frame->missed - 1 : seen;
    uint64_t before = recorder->awaited ? from : 0;
    uint64_t gap = ddx_stats_follow_some(recorder->book, from - before, wanted_up_to, &recorder->decimate);
    recorder->follows = true;
    if (gap)
        say("lost %" PRIu64 " frames while no recorder ran", gap);
    uint64_t missed = recorder->paused ? 0 : decimate_up_to(&recorder->decimate, before);
    ddx_stats_skipped(recorder->book, before - missed);
    if (missed) {
        say("lost %" PRIu64 " frames: they were written before the store kept any for the recorder", missed);
        ddx_stats_in(recorder->book, missed, from);
        ddx_stats_lost(recorder->book, LOST_STORE, missed);
        recorder->lost_store += missed;
    }
}

/* ---- Frame by frame ---- */

/* False if the disk is so far behind that there is no queue for the frame, or no room in it; it is counted then. */
static bool put_into_queue(struct recorder *recorder, const struct ddxvideo_picture *view,
                           const struct recording_frame *frame) {
    if (recorder->recording) {
        bool has_room = recording_put(recorder->recording, view, frame);

        recorder->level = recording_level(recorder->recording);
        return has_room;
    }
    ddx_stats_lost(recorder->book, LOST_RING, 1);
    recorder->lost_store += frame->missed;
    recorder->lost_ring++;
    recorder->level = 100;
    return false;
}

/* Records a frame, and counts the frames missed before it. */
static void put(struct recorder *recorder, const struct ddxvideo_picture *view, const struct recording_frame *frame) {
    int number = view->stamp.frame;

    if (frame->missed)
        count_missed(recorder, frame->missed, number);
    ddx_stats_in(recorder->book, 1, frame->sequence);
    ddx_stats_write(recorder->book); /* before the frame can be on the disk: each frame found there was counted */
    if (!recorder_choose_file(recorder, view)) {
        ddx_stats_lost(recorder->book, LOST_WRITE, 1);
    } else {
        bool full = !put_into_queue(recorder, view, frame);

        if (full && !recorder->queue_full)
            say("losing frames from %d on: the ring is full, the disk is too slow", number);
        recorder->queue_full = full;
    }
    recorder->frame = number;
}

/* Frames were lost before one that is not recorded either: the index entry of the next one counts them. */
static void tell_index(struct recorder *recorder, uint64_t lost) {
    if (recorder->recording)
        recording_missed(recorder->recording, lost);
    else
        recorder->lost_store += lost;
}

/* A frame that cannot be read. */
static void put_broken(struct recorder *recorder, const struct recording_frame *frame) {
    int number = (int)(recorder->frame + 1 + (int64_t)frame->missed);

    if (frame->missed)
        count_missed(recorder, frame->missed, number);
    say("lost frame %d: its numbers do not fit its memory, the program that writes it is broken", number);
    ddx_stats_in(recorder->book, 1, frame->sequence);
    ddx_stats_lost(recorder->book, LOST_STORE, 1);
    tell_index(recorder, frame->missed + 1);
    recorder->frame = number;
}

/*
 * While it is paused. Frames overwritten in the store were not wanted either, except between pictures of the pre-roll.
 * `view` is NULL if the frame is broken.
 */
static void leave_out(struct recorder *recorder, const struct ddxvideo_picture *view,
                      const struct recording_frame *frame, bool wanted) {
    uint64_t left_out;

    if (view && wanted)
        left_out = preroll_put(&recorder->preroll, recorder_ring_frames(recorder), view, frame);
    else
        left_out = preroll_missed(&recorder->preroll, frame->missed + wanted) + !wanted;
    ddx_stats_skipped(recorder->book, left_out);
    ddx_stats_in(recorder->book, 0, frame->sequence);
    recorder->frame = view ? view->stamp.frame : recorder->frame + 1;
}

/* The frame was not wanted; those missed before it were. */
static void pass_over(struct recorder *recorder, const struct recording_frame *frame, int number) {
    if (frame->missed) {
        count_missed(recorder, frame->missed, number);
        tell_index(recorder, frame->missed);
    }
    ddx_stats_skipped(recorder->book, 1);
    ddx_stats_in(recorder->book, 0, frame->sequence);
    recorder->frame = number;
}

/* Recording has failed: a wanted frame is lost. */
static void give_up(struct recorder *recorder, const struct recording_frame *frame) {
    if (recorder->paused)
        return;
    ddx_stats_in(recorder->book, frame->missed + 1, frame->sequence);
    ddx_stats_lost(recorder->book, LOST_STORE, frame->missed);
    ddx_stats_lost(recorder->book, LOST_WRITE, 1);
}

/* A new start would fail again: the exit status is that of bad input. */
static void refuse_layout(struct recorder *recorder, int format) {
    say("%s: its pictures are %s, which no Y4M file can hold; ddxlog records it, with the line: item %s",
        recorder->name, ddxvideo_layout_name(format), recorder->name);
    recorder->status = EXIT_USAGE;
    recorder->done = true;
}

void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;

    recorder->seen = true;
    int error = recorder->done ? 0 : ddxvideo_view_any(recorder->video, frame->data, &view);
    if (error == -EPROTOTYPE)
        recorder_fail(recorder, recorder->name, error);
    if (!error && !recorder->done && !y4m_has(view.geometry.format))
        refuse_layout(recorder, view.geometry.format);
    if (!error && !recorder->done)
        look(recorder, &view);
    bool wanted = decimate_wants(&recorder->decimate, frame->sequence, 1);
    uint64_t missed = decimate_wants(&recorder->decimate, frame->sequence - 1, frame->missed);
    struct recording_frame facts = {frame->time, frame->sequence, missed};
    ddx_stats_skipped(recorder->book, frame->missed - missed);
    if (recorder->done) {
        if (wanted)
            give_up(recorder, &facts);
        return;
    }
    if (!wanted && !recorder->paused)
        pass_over(recorder, &facts, error ? recorder->frame + 1 : view.stamp.frame);
    else if (recorder->paused)
        leave_out(recorder, error ? NULL : &view, &facts, wanted);
    else if (error)
        put_broken(recorder, &facts);
    else
        put(recorder, &view, &facts);
    ddx_stats_write(recorder->book);
}

void recorder_set_paused(struct recorder *recorder, bool paused) {
    struct ddxvideo_picture view;
    struct recording_frame frame;

    if (recorder->paused == paused)
        return;
    recorder->paused = recorder->disk.paused = paused;
    if (paused)
        recorder_end_file(recorder);
    bool first = true;
    while (!paused && !recorder->done && preroll_take(&recorder->preroll, &view, &frame)) {
        if (first) { /* frames missed before it were not wanted */
            ddx_stats_skipped(recorder->book, frame.missed);
            frame.missed = 0;
        }
        first = false;
        put(recorder, &view, &frame);
    }
    uint64_t missed = first ? 0 : preroll_missed_last(&recorder->preroll);
    if (missed) {
        count_missed(recorder, missed, (int)(recorder->frame + 1 + (int64_t)missed));
        tell_index(recorder, missed);
    }
    ddx_stats_skipped(recorder->book, preroll_clear(&recorder->preroll));
    ddx_stats_write(recorder->book);
}
