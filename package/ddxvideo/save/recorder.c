/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The reading side of ddxvideosave, from start to end. */
#include "recorder.h"

#include <ddx_stats.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mp4_read.h"
#include "output.h"
#include "program.h"
#include "video_layout.h"
#include "y4m.h"

/* ---- Repair of plain files ---- */

/* Repairs recordings that a killed recorder left in plain files (those of a pool: pool.h). */

/* Complete frames of a Y4M file, and the bytes up to the end of the last one. -1: not a recording of ours. */
static int64_t count_frames(FILE *file, int64_t size, int64_t *whole) {
    struct y4m_header header;
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    int64_t frames = 0;

    *whole = 0;
    if (!fgets(line, sizeof line, file) || !strchr(line, '\n'))
        return 0;
    *strchr(line, '\n') = 0;
    if (!y4m_parse_header(line, Y4M_SAME, &header, error) || !y4m_is_plain(&header))
        return -1;
    const int64_t bytes = (int64_t)video_layout_bytes(&header.geometry);
    while (fgets(line, sizeof line, file) && strchr(line, '\n')) {
        if (strncmp(line, "FRAME", 5))
            return -1;
        int64_t end = ftello(file) + bytes;
        if (end > size || fseeko(file, end, SEEK_SET))
            break;
        *whole = end;
        frames++;
    }
    return frames;
}

/*
 * Finishes an MP4 file, as its recorder would have, after its last whole frame. A finished one is left as it is.
 * Returns its frames; -1: not a recording of ours, or damaged in the middle.
 */
static int64_t finish_mp4(const char *folder, const char *name, int fd, int64_t size) {
    struct mp4_file file;
    struct mp4_entry *entries;
    enum mp4_next last;
    int error = size < MP4_BLOCK ? 0 : mp4_open(&file, fd);

    if (size < MP4_BLOCK || error)
        return error ? -1 : 0;
    int64_t frames = mp4_entries(&file, &entries, &last);
    if (frames > 0 && !file.end && last != MP4_DAMAGED) {
        int64_t bytes =
            ftruncate(fd, (off_t)file.at) ? -errno : mp4_finish(fd, &file.format, entries, (uint32_t)frames);
        if (bytes < 0)
            say("%s/%s: was left unfinished, and cannot be finished: %s; it can be played", folder, name,
                strerror((int)-bytes));
        else
            say("%s/%s: was left unfinished; finished after its last whole frame, it has %lld", folder, name,
                (long long)frames);
    }
    free(entries);
    return last == MP4_DAMAGED ? -1 : frames;
}

/* Repairs a file that no recorder uses; `own`: it is certainly a recording. Returns its frames; -1: not a recording. */
static int64_t mend(const char *folder, int at, const char *name, bool own) {
    struct stat status;
    int64_t whole, frames = -1;
    int fd = openat(at, name, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    FILE *file = fd < 0 || flock(fd, LOCK_EX | LOCK_NB) || fstat(fd, &status) || !S_ISREG(status.st_mode)
                     ? NULL
                     : fdopen(fd, "r");

    if (!file) {
        if (fd >= 0)
            close(fd);
        return -1;
    }
    bool mp4 = mp4_is_any(fd);
    frames = mp4 ? finish_mp4(folder, name, fd, status.st_size) : count_frames(file, status.st_size, &whole);
    if (own && !frames && !unlinkat(at, name, 0))
        say("%s/%s: was left without a whole frame; removed", folder, name);
    else if (!mp4 && frames > 0 && whole < status.st_size && !ftruncate(fd, whole))
        say("%s/%s: was left within a frame; cut after its last whole one, it has %lld", folder, name,
            (long long)frames);
    fclose(file);
    return frames;
}

/* Finds the file that the counters name, or without counters the newest recording. False: there is none. */
static bool find_left(const struct output *output, DIR *list, const DDX_STATS *stats, char name[NAME_MAX + 1]) {
    struct stat status;
    long highest = 0;

    *name = 0;
    rewinddir(list);
    for (const struct dirent *entry = readdir(list); entry; entry = readdir(list)) {
        long number = output_number(output, entry->d_name);
        bool found = stats ? !fstatat(dirfd(list), entry->d_name, &status, AT_SYMLINK_NOFOLLOW) &&
                                 status.st_ino == stats->file_inode && status.st_dev == stats->file_device
                           : number > highest;

        if (!found)
            continue;
        strcpy(name, entry->d_name);
        highest = number;
        if (stats)
            return true;
    }
    return *name;
}

/*
 * Cuts the file that a former recorder was writing after its last whole frame, finishes it if it is MP4, and reports
 * it; removes a file without a frame. Repaired are the file that the counters name, if it is in this folder, and in a
 * folder also the newest recording of this item. A file that another program records into is left alone. Frames of the
 * former file that were written, but not counted, are counted as out.
 */
static void repair_plain_files(const struct output *output, DDX_STATS_BOOK *book) {
    DDX_STATS stats;
    char folder[PATH_MAX], name[NAME_MAX + 1];
    uint64_t found = 0;

    output_folder(output, folder);
    ddx_stats_get(book, &stats);
    DIR *list = opendir(folder);
    if (list && stats.file_inode && find_left(output, list, &stats, name)) {
        int64_t frames = mend(folder, dirfd(list), name, true);
        uint64_t counted = stats.out - stats.file_out;

        if (frames > 0 && (uint64_t)frames > counted)
            found = (uint64_t)frames - counted;
    }
    if (list && output->is_folder && find_left(output, list, NULL, name))
        mend(folder, dirfd(list), name, false);
    if (list)
        closedir(list);
    ddx_stats_found(book, found);
}

/*
 * The thread that repairs them, which takes long if a file is large or the disk is slow. It has the first turn to
 * write: meanwhile, frames wait in the queue, and no file is opened under the name of the one that is repaired.
 */
static void *mend_leftovers(void *argument) {
    struct recorder *recorder = argument;

    program_thread_signals();
    program_thread_ordinary();
    repair_plain_files(&recorder->output, recorder->book);
    recording_end_turn(&recorder->turn);
    return NULL;
}

/* Begins to repair files that a predecessor of this instance left when it died. */
static void begin_to_mend(struct recorder *recorder) {
    DDX_STATS stats;

    ddx_stats_get(recorder->book, &stats);
    recorder->output.keep = stats.follows || recorder->program.hidden;
    if (recorder->pool)
        return;
    recorder->turn.begun++;
    recorder->mends = !pthread_create(&recorder->mender, NULL, mend_leftovers, recorder);
    if (!recorder->mends)
        mend_leftovers(recorder);
}

/* ---- Commands ---- */

/*
 * Commands to a running recorder (ddx_request.h, item: the recorder's instance; `ddxctl record`):
 *
 *     recording=0   stop: frames are left out, and counted as skipped;  recording=1   continue, in a new file
 *     split=1       the next frame begins a new recording; no frame is lost
 *     pre_roll=N    while it is stopped, keep the last N seconds in memory, and record them first when it continues
 */

struct command {
    const char *name;
    int64_t minimum, maximum;
    void (*execute)(struct recorder *recorder, int64_t value);
};

static void set_recording(struct recorder *recorder, int64_t value) {
    if (recorder->paused != !value)
        say("%s", value ? "recording continues, by request" : "recording stops, by request; frames are skipped");
    recorder_set_paused(recorder, !value);
}

static void split(struct recorder *recorder, int64_t value) {
    (void)value;
    if (recorder->pool && recorder->recording)
        recording_split(recorder->recording);
    else
        recorder_end_file(recorder);
}

static void set_pre_roll(struct recorder *recorder, int64_t value) {
    recorder->preroll.seconds = value;
}

static const struct command commands[] = {
    {"recording", 0, 1, set_recording},
    {"split", 1, 1, split},
    {"pre_roll", 0, PRE_ROLL_MAX, set_pre_roll},
};

static const struct command *find_command(const char *name) {
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        if (!strcmp(commands[i].name, name))
            return &commands[i];
    return NULL;
}

/* 0, or -errno with the reason in text. */
static int check_request(const struct recorder *recorder, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]) {
    for (unsigned i = 0; i < request->count; i++) {
        const char *name = request->change[i].name;
        int64_t value = request->change[i].value;
        const struct command *command = find_command(name);

        if (!command) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: no such parameter", name);
            return -EINVAL;
        }
        if (value < command->minimum || value > command->maximum) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: takes a whole number from %" PRId64 " to %" PRId64 ", not %" PRId64,
                     name, command->minimum, command->maximum, value);
            return -ERANGE;
        }
        if (!recorder->output.is_folder) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: records into one file; with a folder as -output there can be several",
                     name);
            return -EACCES;
        }
        int64_t fits = recorder->geometry.width && !recorder->coded /* otherwise not known */
                           ? preroll_seconds_max(&recorder->geometry, recorder_ring_frames(recorder))
                           : PRE_ROLL_MAX;
        if (command->execute == set_pre_roll && value > fits) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: %" PRId64 " s do not fit into memory, %" PRId64 " s do; more: -ring",
                     name, value, fits);
            return -ERANGE;
        }
        if (command->execute == split && recorder->paused) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: it does not record now", name);
            return -EACCES;
        }
    }
    return 0;
}

/* Takes commands from now on; if the store has no memory for that, a line reports it. */
static void commands_open(struct recorder *recorder, DDX_STORE_ID *id) {
    recorder->requests = ddx_requests_open(id, recorder->program.instance);
    if (!recorder->requests)
        say("%s: cannot receive commands: %s", recorder->program.instance, ddx_error_text(-errno));
}

/* Carries out the next command, if there is one. Waits only for a former recording that is still being written. */
static void commands_tick(struct recorder *recorder) {
    DDX_REQUEST request;
    char text[DDX_ANSWER_TEXT] = "";

    if (!recorder->requests || ddx_requests_take(recorder->requests, &request))
        return;
    int status = check_request(recorder, &request, text);
    for (unsigned i = 0; !status && i < request.count; i++)
        find_command(request.change[i].name)->execute(recorder, request.change[i].value);
    ddx_requests_answer(recorder->requests, status, text);
}

static void commands_close(struct recorder *recorder) {
    ddx_requests_close(recorder->requests);
}

/* ---- Frames ---- */

static const char *const reasons[] = {"store", "ring", "write", "encode", NULL};

/* Frames that the store keeps while the recorder gets no processor: at first, and one second if KEEP_BYTES suffice. */
#define KEEP_FRAMES 8
#define KEEP_FRAMES_MAX 25
#define KEEP_BYTES (4u << 20)
#define READ_TIMEOUT 0.2 /* s; a signal does not end a wait, so waits are short */
#define WAITING_NS INT64_C(1000000000)
#define BUSY 25          /* % of the queue: above this, the disk is needed for the recording */
#define DRAIN_FRAMES 256 /* maximum number of frames taken from the store after TERM */

static void say_kept(const struct recorder *recorder) {
    say("%s: the store has little room, it keeps %u frames for the recorder; more memory: ddxstore -m", recorder->name,
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
        if (recorder->coded)
            encode_load_yield(&recorder->load);
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

int recorder_run(struct recorder *recorder) {
    recorder->begin = ddx_time_now();
    recorder->frame = -1;
    recorder->turn = (struct recording_turn){.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};
    int error = output_check(&recorder->output, recorder->place, recorder->name, recorder->coded ? "mp4" : "y4m");
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
        begin_to_mend(recorder);
        commands_open(recorder, id);
        recorder->disk.place = recorder->place;
        recorder->disk.recycle = recorder->recycle;
        recorder->disk.book = recorder->book;
        recorder->disk.load = recorder->preroll.load = &recorder->load;
        recorder->preroll.h264 = recorder->coded ? &recorder->h264 : NULL;
        recorder->disk.paused = recorder->paused;
        if (recorder->output.is_folder)
            disk_watch_start(&recorder->disk, id, recorder->program.instance);
        if (find_item(recorder, id))
            record(recorder);
    }
    disk_watch_stop(&recorder->disk);
    if (recorder->mends)
        pthread_join(recorder->mender, NULL);
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
