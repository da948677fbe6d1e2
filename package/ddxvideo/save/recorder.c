/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The reading side of ddxvideosave, from start to end. */
#include "recorder.h"

#include <errno.h>
#include <string.h>

#include "commands.h"
#include "recorder_file.h"
#include "recorder_frames.h"
#include "repair_plain.h"

static const char *const reasons[] = {"store", "ring", "write", NULL};

/* Frames that the store keeps while the recorder gets no processor: at first, and one second if KEEP_BYTES suffice. */
#define KEEP_FRAMES 8
#define KEEP_FRAMES_MAX 25
#define KEEP_BYTES (4u << 20)
#define READ_TIMEOUT 0.2 /* s; a signal does not end a wait, so waits are short */
#define WAITING_NS INT64_C(1000000000)
#define BUSY 25          /* % of the queue: above this, the disk is needed for the recording */
#define DRAIN_FRAMES 256 /* maximum number of frames taken from the store after TERM */

static void say_kept(const struct recorder *recorder) {
    say("%s: the store has little room, it keeps %u frames for the recorder; more memory: store -m", recorder->name,
        recorder->keep);
}

/* Before the first frame: the store had no memory for the number. False if it has none for one frame either. */
static bool keep_fewer(struct recorder *recorder) {
    if (recorder->keep < 2 || ddx_store_keep(recorder->video, recorder->keep / 2))
        return false;
    recorder->keep /= 2;
    say_kept(recorder);
    return true;
}

/* At the first frame, since its size is known only now. If there is no room for more, the number stays. */
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

/* Handles the next frame, if it comes within the timeout. False if there was none. */
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

/* Reports once, after a while, that the item does not exist. */
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
    /* Frames published before the stop are recorded; after a failure they are counted as lost. */
    int64_t now = ddx_time_now();
    for (int i = 0; i < DRAIN_FRAMES && take_frame(recorder, 0, now); i++)
        continue;
    ddx_stats_skipped(recorder->book, preroll_clear(&recorder->preroll));
    recorder_end_file(recorder);
    recorder_finish_former(recorder, true);
}

/* ---- Start and end ---- */

/* Whether the disk is needed for the recording; called by the thread that prepares files. */
static bool is_busy(void *argument) {
    const struct recorder *recorder = argument;

    return recorder->level > BUSY;
}

/* Opens the pool, if files come from one. False after a line. */
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
 * Opens the item. If it does not exist yet, the store notes that this reader needs every frame from the first on; with
 * polling, the frames before each poll would be lost. False on a request to stop, or a failure.
 */
static bool find_item(struct recorder *recorder, DDX_STORE_ID *id) {
    recorder->video = program_await(id, recorder->name, recorder->book);
    if (!recorder->video) {
        recorder->status = errno == EINTR ? EXIT_OK : EXIT_FAILED;
        return false;
    }
    recorder->awaited = !*ddx_store_item_type(recorder->video);
    decimate_look(&recorder->decimate, &recorder->geometry); /* as far as it is known before the first frame */
    recorder->keep = recorder->keep_frames ? (unsigned)recorder->keep_frames : KEEP_FRAMES;
    ddx_store_keep(recorder->video, recorder->keep);
    return true;
}

/* Repairs files that a predecessor of this instance left when it died. */
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
    recorder->book = program_book(&recorder->program, reasons);
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
