/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Puts each frame of the store into the queue of the current recording, and counts those missed between them. */
#include "recorder_frames.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

#include "ddx_time.h"
#include "video_layout.h"
#include "y4m.h"

#define RATE_UNKNOWN 25 /* frames a second of an item that does not tell */

/* ---- Former recordings ---- */

/*
 * Whether `present`, which may be NULL, may be added, and another recording begun whose queue has that number of bytes:
 * together they must not take all the memory, however long the disk hangs. A second recording is always allowed.
 */
static bool backlog_has_room(const struct backlog *backlog, const struct recording *present, uint64_t queue_bytes) {
    unsigned count = backlog->count + (present != NULL);
    uint64_t bytes = queue_bytes + (present ? recording_queue_bytes(present) : 0);

    for (unsigned i = 0; i < backlog->count; i++)
        bytes += recording_queue_bytes(backlog->recording[i]);
    return count <= 1 || (count < BACKLOG_MAX && bytes <= 2 * recording_queue_bytes_max());
}

/* Add a closed recording; backlog_has_room() returned true. */
static void backlog_add(struct backlog *backlog, struct recording *recording) {
    backlog->recording[backlog->count++] = recording;
}

/* Take out the oldest recording if it is on disk, with `wait` also if it is not. NULL if there is none. */
static struct recording *backlog_take(struct backlog *backlog, bool wait) {
    if (!backlog->count || (!wait && !recording_is_on_disk(backlog->recording[0])))
        return NULL;
    struct recording *oldest = backlog->recording[0];
    backlog->count--;
    memmove(backlog->recording, backlog->recording + 1, backlog->count * sizeof backlog->recording[0]);
    return oldest;
}

/* ---- The file for a frame ---- */

/* That of the current recording, or a new one. */

void recorder_fail(struct recorder *recorder, const char *what, int error) {
    say("%s: %s", what, ddx_error_text(error));
    recorder->status = EXIT_FAILED;
    recorder->done = true;
}

unsigned recorder_ring_frames(const struct recorder *recorder) {
    return recording_queue_frames(&recorder->geometry, (unsigned)recorder->queue_frames);
}

/* Finishes a recording, and reports its failure. */
static void finish(struct recorder *recorder, struct recording *recording) {
    char path[PATH_MAX];
    int error = recording_finish(recording, path);

    if (!error)
        return;
    if (error == -ECANCELED) { /* a stop was requested: not a failure */
        say("%s: it had no reader; the waiting frames are lost", recorder->place);
        return;
    }
    const char *advice = error == -ENOSPC || error == -EDQUOT ? "make room and start again" : "see to the disk";
    if (error == -EWOULDBLOCK)
        say("%s: another program records into it; name another file, or a folder", recorder->place);
    else if (error == -EIDRM)
        say("%s: recording stopped, the file or its folder was removed; name a folder that stays", path);
    else if (*path)
        say("%s: recording stopped, %s; what was recorded is readable, %s", path, strerror(-error), advice);
    else
        say("%s: no file to record into, %s; %s", recorder->place, strerror(-error), advice);
    recorder->status = EXIT_FAILED;
    recorder->done = true;
}

void recorder_finish_former(struct recorder *recorder, bool wait) {
    struct recording *recording;

    while ((recording = backlog_take(&recorder->backlog, wait)))
        finish(recorder, recording);
}

void recorder_end_file(struct recorder *recorder) {
    if (!recorder->recording)
        return;
    recording_close(recorder->recording);
    backlog_add(&recorder->backlog, recorder->recording);
    recorder->recording = NULL;
    if (recorder->pool)
        pool_recorded_at(recorder->pool, 0);
}

static double rate_of(const struct ddxvideo_geometry *geometry) {
    return geometry->rate_num > 0 && geometry->rate_den > 0 ? (double)geometry->rate_num / geometry->rate_den
                                                            : RATE_UNKNOWN;
}

/* Passes on the recording's rate, by which files are prepared and the remaining time is reported. */
static void tell_rate(struct recorder *recorder) {
    unsigned bytes = recording_frame_bytes(recorder->recording);
    double rate = rate_of(&recorder->geometry);

    recorder->disk.frame_bytes = bytes;
    if (recorder->pool)
        pool_recorded_at(recorder->pool, (uint64_t)(bytes * rate));
}

/*
 * Begins a file for pictures of this geometry. Former files may still be written by their own threads; if their queues
 * leave no memory for one more, nothing is recorded for now.
 */
static void begin_file(struct recorder *recorder, const struct ddxvideo_picture *view,
                       const struct recording_frame *frame) {
    unsigned frames = recorder_ring_frames(recorder);
    uint64_t bytes = frames * recording_frame_memory(&view->geometry);

    if ((unsigned)recorder->queue_frames > frames)
        say("-ring %ld: a quarter of the memory has room for %u frames like these", recorder->queue_frames, frames);
    recorder_finish_former(recorder, false);
    bool room = backlog_has_room(&recorder->backlog, recorder->recording, bytes);
    recorder_end_file(recorder);
    if (!room || recorder->done)
        return;
    struct recording_plan plan = {.output = &recorder->output,
                                  .pool = recorder->pool,
                                  .geometry = view->geometry,
                                  .load = &recorder->load,
                                  .h264 = recorder->coded ? &recorder->h264 : NULL,
                                  .coded = frame->encoded ? preroll_encoder(&recorder->preroll) : NULL,
                                  .queue_frames = frames,
                                  .turn = &recorder->turn,
                                  .lost_store = recorder->lost_store,
                                  .lost_ring = recorder->lost_ring,
                                  .book = recorder->book};
    int error = recording_begin(&plan, &recorder->recording);
    if (error) { /* an error of the system, not of the store */
        say("%s: %s", recorder->place, strerror(-error));
        recorder->status = EXIT_FAILED;
        recorder->done = true;
        return;
    }
    recorder->lost_store = recorder->lost_ring = 0;
    tell_rate(recorder);
}

/* Make sure that the current file fits this frame. False if it cannot be recorded. */
static bool recorder_choose_file(struct recorder *recorder, const struct ddxvideo_picture *view,
                                 const struct recording_frame *frame) {
    if (!recorder->recording || recorder->output.is_folder) {
        if (!recorder->recording || !recording_same_header(recording_geometry(recorder->recording), &view->geometry) ||
            recording_is_gap(recorder->recording, view, frame))
            begin_file(recorder, view, frame);
        return !recorder->done;
    }
    const struct ddxvideo_geometry *now = recording_geometry(recorder->recording);
    if (!ddxvideo_same_layout(now, &view->geometry)) {
        say("%s: recording stopped, the picture changed from %dx%d to %dx%d, and a file holds one kind; give -output "
            "a folder",
            recorder->place, now->width, now->height, view->geometry.width, view->geometry.height);
        recorder->status = EXIT_FAILED;
        recorder->done = true;
        return false;
    }
    if (!recorder->rate_changed && !recording_same_header(now, &view->geometry)) {
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

/* Takes over the geometry, and chooses the frames that are wanted. */
static void look(struct recorder *recorder, struct ddxvideo_picture *view) {
    if (decimate_look(&recorder->decimate, &view->geometry) && !recorder->rate_unknown) {
        say("%s: its rate is unknown, so each frame is recorded; -skip N takes one of N", recorder->name);
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
        if (recorder->coded)
            tell_rate(recorder);
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
    if (!recorder_choose_file(recorder, view, frame)) {
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
static void refuse_layout(struct recorder *recorder, const struct ddxvideo_geometry *geometry) {
    const char *layout = ddxvideo_layout_name(geometry->format);

    if (y4m_has(geometry->format))
        say("%s: its pictures are %dx%d in %s, and H.264 %s; record them with -format y4m", recorder->name,
            geometry->width, geometry->height, layout, h264_refusal(geometry));
    else
        say("%s: its pictures are %s, which no %s file can hold; ddxlog records it, with the line: item %s",
            recorder->name, layout, recorder->coded ? "MP4 or Y4M" : "Y4M", recorder->name);
    recorder->status = EXIT_USAGE;
    recorder->done = true;
}

/* How much of the time that the store keeps a frame has passed, %. */
static unsigned how_late(const struct recorder *recorder, const struct ddx_frame *frame) {
    double age = (double)(ddx_time_now() - frame->time) / SECOND;
    double frames = age * rate_of(&recorder->geometry);

    return frames <= 0 || !recorder->keep ? 0
           : frames < recorder->keep      ? (unsigned)(frames * 100 / recorder->keep)
                                          : 100;
}

void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;

    recorder->seen = true;
    int error = recorder->done ? 0 : ddxvideo_view_any(recorder->video, frame->data, &view);
    if (error == -EPROTOTYPE)
        recorder_fail(recorder, recorder->name, error);
    if (!error && !recorder->done &&
        (recorder->coded ? h264_refusal(&view.geometry) != NULL : !y4m_has(view.geometry.format)))
        refuse_layout(recorder, &view.geometry);
    if (!error && !recorder->done)
        look(recorder, &view);
    bool wanted = decimate_wants(&recorder->decimate, frame->sequence, 1);
    uint64_t missed = decimate_wants(&recorder->decimate, frame->sequence - 1, frame->missed);
    struct recording_frame facts = {frame->time, frame->sequence, missed, how_late(recorder, frame), NULL};
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
