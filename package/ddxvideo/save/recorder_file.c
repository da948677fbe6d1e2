/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Chooses the file for a frame: that of the current recording, or a new one. */
#include "recorder_file.h"

#include <errno.h>
#include <string.h>

#include "video_layout.h"

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

/* Passes on the recording's rate, by which files are prepared and the remaining time is reported. */
static void tell_rate(struct recorder *recorder, const struct ddxvideo_geometry *geometry) {
    unsigned bytes = (unsigned)video_layout_bytes(geometry);
    double rate = geometry->rate_num && geometry->rate_den ? (double)geometry->rate_num / geometry->rate_den : 30;

    recorder->disk.frame_bytes = bytes;
    if (recorder->pool)
        pool_recorded_at(recorder->pool, (uint64_t)(bytes * rate));
}

/*
 * Begins a file for pictures of this geometry. Former files may still be written by their own threads; if their queues
 * leave no memory for one more, nothing is recorded for now.
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
    if (error) { /* an error of the system, not of the store */
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

bool recorder_choose_file(struct recorder *recorder, const struct ddxvideo_picture *view) {
    if (!recorder->recording || recorder->output.is_folder) {
        if (!recorder->recording || !same_header(recording_geometry(recorder->recording), &view->geometry))
            begin_file(recorder, view);
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
    if (!recorder->rate_changed && !same_header(now, &view->geometry)) {
        say("%s: frame rate or pixel aspect changed; the header keeps the first ones, the times are right",
            recorder->place);
        recorder->rate_changed = true;
    }
    return true;
}
