/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The reading side of ddxvideosave: every frame out of the store, into the queue of the present recording. */
#include "recorder.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

#include "repair_plain.h"
#include "commands.h"
#include "y4m.h"

static const char *const reasons[] = {"store", "ring", "write", NULL};

/* Frames that the store keeps for us while we get no processor: at first, and a second's if so much memory does. */
#define KEEP_FRAMES 8
#define KEEP_FRAMES_MAX 25
#define KEEP_BYTES (4u << 20)
#define READ_TIMEOUT 0.2 /* s; a signal does not end a wait, so look up from time to time */
#define WAITING_NS INT64_C(1000000000)
#define BUSY 25          /* %: from there on the disk has enough to do with what is in the queue */
#define DRAIN_FRAMES 256 /* bound on what is still taken from the store after TERM */

static void recorder_fail(struct recorder *recorder, const char *what, int error) {
    say("%s: %s", what, ddx_error_text(error));
    recorder->status = EXIT_FAILED;
    recorder->done = true;
}

/* ---- Which file ---- */

/* End a recording. When it failed, say so. */
static void finish(struct recorder *recorder, struct recording *recording) {
    char path[PATH_MAX];
    int error = recording_finish(recording, path);

    if (!error)
        return;
    if (error == -ECANCELED) { /* a request to stop: that is no failure */
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

/* The former ones that are on disk by now; or, waiting for it, all. */
static void recorder_finish_former(struct recorder *recorder, bool wait) {
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

/* Preparing files and reporting the remaining time need the recording's rate. */
static void tell_rate(struct recorder *recorder, const struct ddxvideo_geometry *geometry) {
    unsigned bytes = recording_frame_bytes(geometry);
    double rate = geometry->rate_num && geometry->rate_den ? (double)geometry->rate_num / geometry->rate_den : 30;

    recorder->disk.frame_bytes = bytes;
    if (recorder->pool)
        pool_recorded_at(recorder->pool, (uint64_t)(bytes * rate));
}

/*
 * Begin a file for pictures like this one. Former ones are still being written meanwhile, by their own threads; where
 * the disk has left no room for one more queue, there is no recording then.
 */
static void begin_file(struct recorder *recorder, const struct ddxvideo_picture *view) {
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
                                  .queue_frames = frames,
                                  .turn = &recorder->turn,
                                  .lost_store = recorder->lost_store,
                                  .lost_ring = recorder->lost_ring,
                                  .book = recorder->book};
    int error = recording_begin(&plan, &recorder->recording);
    if (error) { /* the system's, not the store's */
        say("%s: %s", recorder->place, strerror(-error));
        recorder->status = EXIT_FAILED;
        recorder->done = true;
        return;
    }
    recorder->lost_store = recorder->lost_ring = 0;
    tell_rate(recorder, &view->geometry);
}

static bool same_header(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b) {
    return ddxvideo_same_layout(a, b) && a->rate_num == b->rate_num && a->rate_den == b->rate_den &&
           a->aspect_num == b->aspect_num && a->aspect_den == b->aspect_den;
}

/* Make sure that the present file fits this frame. False if it cannot be recorded. */
static bool recorder_choose_file(struct recorder *recorder, const struct ddxvideo_picture *view) {
    if (!recorder->recording || recorder->output.is_folder) {
        if (!recorder->recording || !same_header(recording_geometry(recorder->recording), &view->geometry))
            begin_file(recorder, view);
        return !recorder->done;
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

/* What kind of pictures come, and which of them are wanted. */
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
static void recorder_follow(struct recorder *recorder, const struct ddx_frame *frame) {
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

/* A frame that is to be recorded, and what was missed before it. */
static void put(struct recorder *recorder, const struct ddxvideo_picture *view, const struct recording_frame *frame) {
    int number = view->stamp.frame;

    if (frame->missed)
        count_missed(recorder, frame->missed, number);
    ddx_stats_in(recorder->book, 1, frame->sequence);
    ddx_stats_write(recorder->book); /* before it can be on the disk: what is found there was in */
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

/* Of frames that were lost before one that is not recorded either: the next one's index entry says so. */
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
 * While it is paused; also for frames overwritten in the store: unwanted, except between pictures of the pre-roll.
 * `view` is NULL if it is broken.
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

/* It was not to be recorded; what was missed before it was. */
static void pass_over(struct recorder *recorder, const struct recording_frame *frame, int number) {
    if (frame->missed) {
        count_missed(recorder, frame->missed, number);
        tell_index(recorder, frame->missed);
    }
    ddx_stats_skipped(recorder->book, 1);
    ddx_stats_in(recorder->book, 0, frame->sequence);
    recorder->frame = number;
}

/* It can be recorded no more, and was to be. */
static void give_up(struct recorder *recorder, const struct recording_frame *frame) {
    if (recorder->paused)
        return;
    ddx_stats_in(recorder->book, frame->missed + 1, frame->sequence);
    ddx_stats_lost(recorder->book, LOST_STORE, frame->missed);
    ddx_stats_lost(recorder->book, LOST_WRITE, 1);
}

/* Started again, it would fail again: the exit status is that of bad input. */
static void refuse_layout(struct recorder *recorder, int format) {
    say("%s: its pictures are %s, which no Y4M file can hold; ddxlog records it, with the line: item %s",
        recorder->name, ddxvideo_layout_name(format), recorder->name);
    recorder->status = EXIT_USAGE;
    recorder->done = true;
}

static void recorder_handle(struct recorder *recorder, const struct ddx_frame *frame) {
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

unsigned recorder_ring_frames(const struct recorder *recorder) {
    return recording_queue_frames(&recorder->geometry, (unsigned)recorder->queue_frames);
}

static void say_kept(const struct recorder *recorder) {
    say("%s: the store has little room, it keeps %u frames for the recorder; more memory: store -m", recorder->name,
        recorder->keep);
}

/* Before the first frame: the store had no memory for that number. False if there is none for one frame either. */
static bool keep_fewer(struct recorder *recorder) {
    if (recorder->keep < 2 || ddx_store_keep(recorder->video, recorder->keep / 2))
        return false;
    recorder->keep /= 2;
    say_kept(recorder);
    return true;
}

/* With the first frame, as its size is known only now. Where there is no room for more, it stays as it is. */
static void keep_more(struct recorder *recorder) {
    struct ddx_item_info info;

    if (ddx_store_kept(recorder->video) < recorder->keep) {
        recorder->keep = ddx_store_kept(recorder->video);
        say_kept(recorder);
    }
    if (recorder->keep_frames || recorder->keep != KEEP_FRAMES)
        return;
    if (ddx_store_item_info(recorder->video, &info) || !info.frame_bytes)
        return;
    uint64_t frames = KEEP_BYTES / info.frame_bytes;
    if (frames > KEEP_FRAMES_MAX)
        frames = KEEP_FRAMES_MAX;
    if (frames > KEEP_FRAMES && !ddx_store_keep(recorder->video, (unsigned)frames))
        recorder->keep = (unsigned)frames;
}

/* The next frame, if it comes within the timeout. False if there was none. */
static bool take_frame(struct recorder *recorder, double timeout, int64_t not_after) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(recorder->video, &frame, timeout, DDX_IN_ORDER);

    if (!recorder->follows && (!error || error == -ETIMEDOUT))
        recorder_follow(recorder, error ? NULL : &frame);
    if (error == -ETIMEDOUT || (error == -EBUSY && keep_fewer(recorder)))
        return false;
    if (error) {
        if (!recorder->done)
            recorder_fail(recorder, recorder->name, error);
        return false;
    }
    bool wanted = frame.time <= not_after;
    if (!recorder->seen)
        keep_more(recorder); /* before it is recorded: a program that sees the recording may rely on the number kept */
    if (wanted)
        recorder_handle(recorder, &frame);
    ddx_store_release(recorder->video);
    return wanted;
}

/* Say once that there is no such item, when that lasts. */
static void tell_waiting(struct recorder *recorder) {
    if (recorder->seen || recorder->said_waiting || ddx_time_now() - recorder->begin < WAITING_NS)
        return;
    recorder->said_waiting = true;
    program_say_awaited(recorder->video, recorder->name);
}

static void record(struct recorder *recorder) {
    while (!program_stopping() && !recorder->done) {
        take_frame(recorder, recorder->follows ? READ_TIMEOUT : 0, INT64_MAX); /* only followed frames count */
        tell_waiting(recorder);
        commands_tick(recorder);
        program_tick(recorder->book);
        recorder_finish_former(recorder, false);
        if (recorder->recording && recording_error(recorder->recording))
            recorder->done = true;
    }
    /* What was published before we were told to stop is recorded; before we failed, it is lost, and counted. */
    int64_t now = ddx_time_now();
    for (int i = 0; i < DRAIN_FRAMES && take_frame(recorder, 0, now); i++)
        continue;
    ddx_stats_skipped(recorder->book, preroll_clear(&recorder->preroll));
    recorder_end_file(recorder);
    recorder_finish_former(recorder, true);
}

/* ---- Start and end ---- */

/* Whether the disk is needed for the recording: asked by the thread that prepares files. */
static bool is_busy(void *argument) {
    const struct recorder *recorder = argument;

    return recorder->level > BUSY;
}

/* Where there is one, files come from the pool. False after a line. */
static bool open_pool(struct recorder *recorder) {
    if (!recorder->segment)
        return true;
    if (!recorder->output.is_folder) {
        say("-segment: -output %s is no folder", recorder->place);
        return false;
    }
    int error = pool_open(recorder->place, recorder->program.instance, (uint64_t)recorder->segment << 20,
                          recorder->recycle, &recorder->pool);
    if (!error)
        error = recorder->recover ? pool_recover(recorder->pool) : pool_prepare(recorder->pool, is_busy, recorder);
    if (error == -EACCES)
        say("-output %s: its pool belongs to another user; record as that user, or to another folder", recorder->place);
    else if (error)
        say("-output %s: no files to record into: %s", recorder->place, strerror(-error));
    return !error;
}

/*
 * The item; if it does not exist yet, the store notes that this reader needs every frame from the first on. With
 * polling, the frames before each poll would be lost. False on a request to stop, or a failure.
 */
static bool find_item(struct recorder *recorder, DDX_STORE_ID *id) {
    recorder->video = program_await(id, recorder->name, recorder->book);
    if (!recorder->video) {
        recorder->status = errno == EINTR ? EXIT_OK : EXIT_FAILED;
        return false;
    }
    recorder->awaited = !*ddx_store_item_type(recorder->video);
    decimate_look(&recorder->decimate, &recorder->geometry); /* what is known before there is a frame */
    recorder->keep = recorder->keep_frames ? (unsigned)recorder->keep_frames : KEEP_FRAMES;
    ddx_store_keep(recorder->video, recorder->keep);
    return true;
}

/* Files that a predecessor of this instance left when it died. */
static void mend_leftovers(struct recorder *recorder) {
    DDX_STATS stats;

    ddx_stats_get(recorder->book, &stats);
    recorder->output.keep = stats.follows || recorder->program.hidden;
    if (!recorder->pool)
        repair_plain_files(&recorder->output, recorder->book);
}

int recorder_run(struct recorder *recorder) {
    recorder->begin = ddx_time_now();
    recorder->frame = -1;
    recorder->turn = (struct recording_turn){.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};
    int error = output_check(&recorder->output, recorder->place, recorder->name, "y4m");
    if (error) {
        say("-output %s: %s; name a file or a folder that can be written", recorder->place, strerror(-error));
        return EXIT_FAILED;
    }
    if (!strcmp(recorder->place, "-"))
        program_report_to(stderr);
    if (recorder->paused && !recorder->output.is_folder) {
        say("-start paused: -output %s is no folder", recorder->place);
        return EXIT_USAGE;
    }
    recorder->book = ddx_stats_open(recorder->program.instance, reasons);
    if (!recorder->book) {
        say("-instance %s: %s", recorder->program.instance, ddx_error_text(-errno));
        return EXIT_USAGE;
    }
    if (!open_pool(recorder)) {
        ddx_stats_close(recorder->book);
        return EXIT_FAILED;
    }
    if (recorder->recover) {
        pool_close(recorder->pool);
        ddx_stats_close(recorder->book);
        return EXIT_OK;
    }
    DDX_STORE_ID *id = program_connect(&recorder->program);
    if (id && !program_attach(&recorder->program, recorder->book, id, recorder->name))
        recorder->status = EXIT_FAILED;
    else if (id) {
        mend_leftovers(recorder);
        commands_open(recorder, id);
        recorder->disk.place = recorder->place;
        recorder->disk.recycle = recorder->recycle;
        recorder->disk.book = recorder->book;
        recorder->disk.paused = recorder->paused;
        if (recorder->output.is_folder)
            disk_watch_start(&recorder->disk, id, recorder->program.instance);
        if (find_item(recorder, id))
            record(recorder);
    }
    disk_watch_stop(&recorder->disk);
    if (recorder->status && !program_stopping())
        ddx_stats_fail(recorder->book);
    program_report(recorder->book);
    ddx_stats_close(recorder->book);
    if (recorder->pool)
        pool_close(recorder->pool);
    commands_close(recorder);
    ddx_store_done_item(recorder->video);
    ddx_store_close(id);
    return recorder->status;
}
