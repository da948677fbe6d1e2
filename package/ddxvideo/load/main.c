/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoload: plays a Y4M or MP4 file into the store. */
#include <errno.h>
#include <replay_clock.h>
#include <string.h>

#include "clip.h"
#include "program.h"
#include "schedule.h"
#include "video_layout.h"

struct player {
    /* settings: */
    struct program program; /* its argument is the file */
    const char *name;
    bool loop;
    long readers;
    int format;        /* enum ddx_video_format of the pictures in the item */
    const char *clock; /* name of the DDX_REPLAY_CLOCK to follow; NULL: start at once */
    struct schedule_speed speed;
    /* state: */
    struct clip file;
    struct schedule schedule;
    struct schedule_pace pace;
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *video, *counter, *parameters;
    int64_t begin; /* when the first frame was due, ns; with a clock it may be before the program's start */
    bool begun;
    bool patient;       /* waits for readers, which set the pace */
    bool cut;           /* a line has reported that the file ends within a frame */
    bool damaged;       /* the previous frame could not be decoded */
    int64_t not_before; /* with a clock: earlier frames are left out */
    uint64_t frame;     /* number of the next frame */
    int64_t published;  /* time of the last frame; before the first one, of the start */
};

/* ---- Player ---- */

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE, LOST_DECODE };
static const char *const reasons[] = {"store", "decode", NULL};

#define POLL_NS INT64_C(5000000)

static void report(const struct player *player) {
    say("%s: %s", player->program.argument, player->file.error);
}

static int exit_status(enum clip_result result) {
    return result == CLIP_BAD ? EXIT_USAGE : EXIT_FAILED;
}

/* False on a request to stop. */
static bool wait_for_readers(struct player *player) {
    bool said = false;
    int64_t begin = ddx_time_now();

    while (ddx_store_readers(player->video) < player->readers) {
        if (!said && ddx_time_now() - begin > 200 * POLL_NS) {
            say("waiting for %ld readers of %s", player->readers, player->name);
            said = true;
        }
        if (!program_sleep_until(ddx_time_now() + POLL_NS, player->book))
            return false;
    }
    return true;
}

/*
 * Wait for the clock, and compute from it the due time of the first frame, which may be past: frames may have been
 * recorded before the part that is replayed. EXIT_OK, also on a request to stop; or the exit status, after a line.
 */
static int follow_clock(struct player *player) {
    DDX_REPLAY_CLOCK clock = {.replayed = 0};
    int64_t since = ddx_time_now();

    if (player->file.start < 0) {
        say("%s: has no time of recording (XDDX_START), so it cannot follow -clock", player->program.argument);
        return EXIT_USAGE;
    }
    DDX_STORE_ITEM *item = program_find(player->id, player->clock, player->book);
    if (!item)
        return program_stopping() ? EXIT_OK : EXIT_FAILED;
    int error = strcmp(ddx_store_item_type(item), "DDX_REPLAY_CLOCK") ? -EPROTOTYPE : -ETIMEDOUT, tail = DDX_CURRENT;
    while ((error == -ETIMEDOUT || (!error && clock.replayed < since)) && !program_stopping()) {
        error = ddx_store_read(item, &clock, NULL, 0.2, tail);
        tail = error ? tail : DDX_NEXT; /* the current one may be of the previous replay */
        program_tick(player->book);
    }
    ddx_store_done_item(item);
    if (program_stopping())
        return EXIT_OK;
    if (error || !clock.num || !clock.den) {
        say("-clock %s: %s", player->clock, error ? ddx_error_text(error) : "not the clock of a replay");
        return EXIT_FAILED;
    }
    int64_t ahead = player->file.start - clock.recorded;
    player->speed = (struct schedule_speed){clock.num, clock.den};
    player->begin = ahead < 0 ? clock.replayed - schedule_scale(-ahead, clock.den, clock.num)
                              : clock.replayed + schedule_scale(ahead, clock.den, clock.num);
    player->not_before = clock.replayed;
    return EXIT_OK;
}

/* Called before the first frame. */
static int begin(struct player *player) {
    player->begun = true;
    if (!wait_for_readers(player))
        return EXIT_OK;
    player->begin = ddx_time_now();
    int status = player->clock ? follow_clock(player) : EXIT_OK;
    player->published = ddx_time_now();
    return status;
}

/* A frame's time on the monotonic clock: it is published then, and has this time in the item. */
static int64_t due_time(const struct player *player, int64_t offset) {
    struct schedule_speed speed = player->speed;

    if (speed.num) /* -rate 0 keeps the recorded steps */
        offset = schedule_scale(offset, speed.den, speed.num);
    return offset > INT64_MAX - player->begin ? INT64_MAX : player->begin + offset;
}

/* Wait until the loaned frame is due, and publish it. EXIT_OK, or the exit status after a line. */
static int publish(struct player *player, struct ddxvideo_frame *frame, int64_t recorded) {
    int status = player->begun ? EXIT_OK : begin(player);

    if (status || program_stopping()) {
        ddx_store_cancel(player->video);
        return status;
    }
    int64_t due = due_time(player, schedule_next(&player->schedule, recorded));
    if (player->clock && due < player->not_before) {
        ddx_store_cancel(player->video);
        ddx_stats_skipped(player->book, 1);
        player->frame++;
        return EXIT_OK;
    }
    if (player->speed.num && !program_sleep_until(schedule_catch_up(&player->pace, due), player->book)) {
        ddx_store_cancel(player->video);
        return EXIT_OK;
    }
    frame->stamp = (struct ddxvideo_stamp){.frame = (int)(player->frame & INT32_MAX),
                                           .time = due,
                                           .wall_offset = ddxvideo_wall_offset(),
                                           .source_sequence = (int64_t)player->frame};
    ddx_stats_in(player->book, 1, 0);
    ddx_stats_publishing(player->book, ddx_store_written(player->video) + 1);
    int error = ddxvideo_publish(player->video, frame);
    int64_t now = ddx_time_now();
    if (error) {
        ddx_stats_lost(player->book, LOST_STORE, 1);
        say("%s: %s", player->name, ddx_error_text(error));
        return EXIT_FAILED;
    }
    if (player->counter)
        ddxvideo_counter_write(player->counter, frame->stamp.frame);
    ddx_stats_out(player->book, 1, now - (player->speed.num ? due : player->published));
    ddx_stats_write(player->book);
    program_tick(player->book);
    player->pace = (struct schedule_pace){true, due, now};
    player->published = now;
    player->frame++;
    return EXIT_OK;
}

/* A frame that cannot be decoded is left out, and counted; the first of several is reported. */
static void count_damaged(struct player *player, int64_t recorded) {
    if (!player->damaged)
        say("%s: %s; frames are left out up to one that can be decoded", player->program.argument, player->file.error);
    player->damaged = true;
    schedule_next(&player->schedule, recorded);
    ddx_stats_in(player->book, 1, 0);
    ddx_stats_lost(player->book, LOST_DECODE, 1);
    player->frame++;
}

/* Play the rest of the file. */
static enum clip_result play_pass(struct player *player, int *status) {
    while (!program_stopping()) {
        struct ddxvideo_frame frame;
        int64_t recorded;

        if (player->patient && !program_wait_for_room(player->video, &player->patient, player->book))
            break;
        int error = ddxvideo_loan(player->video, &player->file.geometry, &frame);
        if (program_try_again(error, player->book)) /* a file can wait */
            continue;
        if (error == -ENOBUFS) /* stop was requested */
            break;
        if (error) {
            say("%s: %s", player->name, ddx_error_text(error));
            *status = EXIT_FAILED;
            return CLIP_ERROR;
        }
        enum clip_result result = clip_read(&player->file, frame.plane, &recorded);
        if (result == CLIP_DAMAGED) {
            ddx_store_cancel(player->video);
            count_damaged(player, recorded);
            continue;
        }
        player->damaged = false;
        if (result != CLIP_OK) {
            ddx_store_cancel(player->video);
            if (result == CLIP_BAD && player->file.cut && (player->file.frames || program_stopping())) {
                if (!program_stopping() && !player->cut) /* reported once, even with -loop */
                    report(player);
                player->cut = true;
                return CLIP_END;
            }
            if (result != CLIP_END) {
                report(player);
                *status = exit_status(result);
            }
            return result;
        }
        *status = publish(player, &frame, recorded);
        if (*status)
            return CLIP_ERROR;
    }
    return CLIP_OK;
}

static int play(struct player *player) {
    int status = EXIT_OK;
    const struct ddxvideo_geometry *geometry = &player->file.geometry;

    if (!geometry->rate_num)
        say("%s: no usable frame rate in the header, using 25", player->program.argument);
    schedule_init(&player->schedule, geometry->rate_num ? (uint32_t)geometry->rate_num : 25,
                  geometry->rate_num ? (uint32_t)geometry->rate_den : 1);
    player->patient = !player->speed.num && player->readers;
    while (play_pass(player, &status) == CLIP_END && player->loop && player->file.frames && !program_stopping()) {
        enum clip_result result = clip_rewind(&player->file);

        if (result != CLIP_OK) {
            report(player);
            return exit_status(result);
        }
        schedule_loop(&player->schedule);
    }
    if (!status && !player->frame && !program_stopping()) {
        say("%s: has no frame; record or copy it again", player->program.argument);
        status = EXIT_USAGE;
    }
    return status;
}

/* Publish the settings of this source, like those of a camera; they cannot be changed. */
static int show_parameters(struct player *player, DDX_STORE_ID *id) {
    static const char *const names[] = {"rate_permille", "loop", "readers"};
    const int values[] = {(int)((int64_t)player->speed.num * 1000 / player->speed.den), player->loop,
                          (int)player->readers};
    DDX_VIDEO_PARAMETERS set = {.count = 3};
    int error = ddxvideo_parameters_create(id, player->name, &player->parameters);

    if (error)
        return error;
    for (int i = 0; i < set.count; i++) {
        strcpy(set.parameter[i].name, names[i]);
        set.parameter[i].value = set.parameter[i].minimum = set.parameter[i].maximum = values[i];
        set.parameter[i].initial = values[i];
        set.parameter[i].step = 1;
        set.parameter[i].flags = DDX_VIDEO_PARAMETER_READ_ONLY;
    }
    return ddxvideo_parameters_write(player->parameters, &set);
}

static int open_items(struct player *player, DDX_STORE_ID *id) {
    if (!program_attach(&player->program, player->book, id, NULL))
        return EXIT_FAILED;
    int error = ddxvideo_create(id, player->name, &player->file.geometry, &player->video);
    if (error) {
        say("%s: %s", player->name, ddx_error_text(error));
        return EXIT_FAILED;
    }
    ddx_stats_published(player->book, ddx_store_written(player->video));
    error = ddxvideo_counter_create(id, player->name, &player->counter);
    if (!program_does_without(player->name, ".frame", error) ||
        !program_does_without(player->name, ".parameters", show_parameters(player, id)))
        return EXIT_FAILED;
    return EXIT_OK;
}

/* Play the file. Returns the exit status. */
static int player_run(struct player *player) {
    int status;

    y4m_stop_when(program_stopping);
    enum clip_result result = clip_open(&player->file, player->program.argument, player->format);
    if (result != CLIP_OK) {
        status = program_stopping() ? EXIT_OK : exit_status(result);
        if (status)
            report(player);
        clip_close(&player->file);
        return status;
    }
    player->book = program_book(&player->program, reasons);
    DDX_STORE_ID *id = player->id = program_connect(&player->program);
    status = id ? open_items(player, id) : EXIT_OK;
    if (id && !status)
        status = play(player);
    program_report(player->book);
    ddx_stats_close(player->book);
    ddx_store_done_item(player->parameters);
    ddx_store_done_item(player->counter);
    ddx_store_done_item(player->video);
    ddx_store_close(id);
    clip_close(&player->file);
    return status;
}

/* ---- Program ---- */

int main(int argc, char **argv) {
    struct player player = {.name = "video"};
    const char *rate = "1", *layout_name = "YUV420P";
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to write (default: video)", OPTION_NAME, &player.name, 0,
         DDX_NAME_MAX - (long)sizeof ".parameters" + 1},
        {"loop", NULL, "play it again and again; times and frame numbers go on", OPTION_FLAG, &player.loop, 0, 0},
        {"rate", "X", "play X times as fast (default: 1); 0: as fast as possible, with -readers as they read",
         OPTION_TEXT, &rate, 0, 0},
        {"readers", "N", "wait for N readers of the item before the first frame", OPTION_NUMBER, &player.readers, 0,
         1000},
        {"layout", "LAYOUT", "pictures in " VIDEO_LAYOUT_NAMES " (default: YUV420P)", OPTION_TEXT, &layout_name, 0, 0},
        {"clock", "ITEM", "begin with the replay of `ddxlog -replay FILE -clock ITEM`", OPTION_TEXT, &player.clock, 0,
         0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    player.program = (struct program){
        .name = "ddxvideoload",
        .positional = "FILE",
        .purpose = "Plays a Y4M file, or an MP4 file of ddxvideosave, into the store, as a video item; its frame\n"
                   "numbers go into item `<name>.frame`, its settings into `<name>.parameters`.\n"
                   "Each frame is written when it is due: by the times that ddxvideosave recorded, or else by the\n"
                   "frame rate in the file. A late frame is written late, at most two in the time of one; none is\n"
                   "left out. Pictures in another layout are converted.",
        .notes = "The time of a frame in the item is its due time: the time of the first frame plus its recorded\n"
                 "time (divided by X; with -rate 0 as recorded). A Y4M FILE may be a pipe, and `-` is standard\n"
                 "input: ffmpeg ... | ddxvideoload -. A file that ends within a frame is played up to there; a line\n"
                 "says so.",
        .options = options,
    };
    program_start(&player.program, argc, argv);
    if (!schedule_parse_speed(rate, &player.speed))
        program_bad_usage("-rate %s: a number from 0 to 1000 is needed", rate);
    if (player.clock && (player.loop || strcmp(rate, "1") != 0))
        program_bad_usage("-clock sets the rate and plays once: not with -rate or -loop");
    const struct video_layout *layout = video_layout_named(layout_name);
    if (!layout)
        program_bad_usage("-layout %s: " VIDEO_LAYOUT_NAMES " is needed", layout_name);
    player.format = layout->format;
    return player.program.check ? EXIT_OK : player_run(&player);
}
