/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "player.h"

#include <errno.h>
#include <replay_clock.h>
#include <string.h>

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_STORE };
static const char *const reasons[] = {"store", NULL};

#define POLL_NS INT64_C(5000000)

static void report(const struct player *player) {
    say("%s: %s", player->program.argument, player->file.error);
}

static int exit_status(enum y4m_result result) {
    return result == Y4M_BAD ? EXIT_USAGE : EXIT_FAILED;
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

/* Play the rest of the file. */
static enum y4m_result play_pass(struct player *player, int *status) {
    while (!program_stopping()) {
        struct ddxvideo_frame frame;
        int64_t recorded;

        if (player->patient && !program_wait_for_room(player->video, &player->patient, player->book))
            break;
        int error = ddxvideo_loan(player->video, &player->file.header.geometry, &frame);
        if (program_try_again(error, player->book)) /* a file can wait */
            continue;
        if (error == -ENOBUFS) /* stop was requested */
            break;
        if (error) {
            say("%s: %s", player->name, ddx_error_text(error));
            *status = EXIT_FAILED;
            return Y4M_ERROR;
        }
        enum y4m_result result = y4m_read(&player->file, frame.plane, &recorded);
        if (result != Y4M_OK) {
            ddx_store_cancel(player->video);
            if (result == Y4M_BAD && player->file.cut && (player->file.frames || program_stopping())) {
                if (!program_stopping() && !player->cut) /* reported once, even with -loop */
                    report(player);
                player->cut = true;
                return Y4M_END;
            }
            if (result != Y4M_END) {
                report(player);
                *status = exit_status(result);
            }
            return result;
        }
        *status = publish(player, &frame, recorded);
        if (*status)
            return Y4M_ERROR;
    }
    return Y4M_OK;
}

static int play(struct player *player) {
    int status = EXIT_OK;
    const struct ddxvideo_geometry *geometry = &player->file.header.geometry;

    if (!geometry->rate_num)
        say("%s: no usable frame rate in the header, using 25", player->program.argument);
    schedule_init(&player->schedule, geometry->rate_num ? (uint32_t)geometry->rate_num : 25,
                  geometry->rate_num ? (uint32_t)geometry->rate_den : 1);
    player->patient = !player->speed.num && player->readers;
    while (play_pass(player, &status) == Y4M_END && player->loop && player->file.frames &&
           !program_stopping()) {
        enum y4m_result result = y4m_rewind(&player->file);

        if (result != Y4M_OK) {
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
    int error = ddxvideo_create(id, player->name, &player->file.header.geometry, &player->video);
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

int player_run(struct player *player) {
    int status;

    y4m_stop_when(program_stopping);
    enum y4m_result result = y4m_open(&player->file, player->program.argument, player->format);
    if (result != Y4M_OK) {
        status = program_stopping() ? EXIT_OK : exit_status(result);
        if (status)
            report(player);
        y4m_close(&player->file);
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
    y4m_close(&player->file);
    return status;
}
