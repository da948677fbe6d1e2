/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "replay.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <replay_clock.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ddx_time.h"

/* Lines on standard input; signals are served while waiting. */

/* Wait for the next line on standard input. False: end of input, or a request to stop. */
static bool replay_wait_line(struct replay *replay) {
    for (;;) {
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        char c;

        program_tick(replay->book);
        if (program_stopping())
            return false;
        if (poll(&input, 1, 200) <= 0)
            continue;
        ssize_t size = read(STDIN_FILENO, &c, 1);
        if (size <= 0)
            return false;
        if (c == '\n')
            return true;
    }
}

static const char *const reasons[] = {"store", NULL};
enum { LOST_STORE };

#define POLL_NS INT64_C(5000000)
#define AHEAD_NS SECOND           /* with -clock: time for the other replays to get ready */
#define LOOP_NS INT64_C(10000000) /* between the last value and the first one again */

/* The CLOCK_MONOTONIC time at which a log time is replayed. */
static int64_t due_time(const struct replay *replay, uint64_t time) {
    uint64_t offset = time > replay->origin ? time - replay->origin : 0;
    int64_t scaled = offset > INT64_MAX ? INT64_MAX : (int64_t)offset;

    if (replay->speed.num) /* -rate 0 keeps the recorded steps */
        scaled = schedule_scale(scaled, replay->speed.den, replay->speed.num);
    return scaled > INT64_MAX - replay->begin ? INT64_MAX : replay->begin + scaled;
}

static bool wait_for_readers(struct replay *replay) {
    bool said = false;
    int64_t begin = ddx_time_now();

    while (items_readers(replay) < replay->readers) {
        if (!said && ddx_time_now() - begin > SECOND) {
            say("waiting for %ld readers of each item", replay->readers);
            said = true;
        }
        if (!program_sleep_until(ddx_time_now() + POLL_NS, replay->book))
            return false;
    }
    return true;
}

/* Publish the start of the replay for other replays. 0 or -errno. */
static int write_clock(struct replay *replay) {
    if (!replay->clock)
        return 0;
    const DDX_REPLAY_CLOCK clock = {.recorded = (int64_t)(replay->origin - (uint64_t)replay->wall_offset),
                                    .replayed = replay->begin,
                                    .num = replay->speed.num,
                                    .den = replay->speed.den};
    return ddx_store_write(replay->clock_item, &clock, NULL);
}

/* Replay one message, when it is due. False: a request to stop, or no more steps. */
static bool play(struct replay *replay, const struct mcap_message *message, bool *stepped) {
    int64_t due = due_time(replay, message->log_time);
    int error;

    if (replay->step) {
        if (!*stepped && !replay_wait_line(replay))
            return false;
        *stepped = true;
        due = ddx_time_now();
    } else if (replay->speed.num && !program_sleep_until(due, replay->book)) {
        return false;
    }
    int64_t before = replay->speed.num && !replay->step ? due : ddx_time_now();
    struct replay_item *item = items_write(replay, message, due, &error);
    int64_t now = ddx_time_now();
    if (item || error)
        ddx_stats_in(replay->book, 1, 0);
    if (item)
        ddx_stats_out(replay->book, 1, now - before);
    else if (error)
        ddx_stats_lost(replay->book, LOST_STORE, 1);
    if (replay->step && item) {
        printf("%s %" PRIu32 " %" PRId64 "\n", item->topic, message->sequence,
               (int64_t)(message->publish_time - (uint64_t)replay->wall_offset));
        fflush(stdout);
        *stepped = replay->tick && strcmp(replay->tick, item->topic) != 0;
    }
    program_tick(replay->book);
    return true;
}

/* Replay from the first message to the last. False: a request to stop, or a failure. */
static bool play_pass(struct replay *replay, uint64_t first, uint64_t *last) {
    struct mcap_message message;
    bool stepped = false;
    int result;
    uint64_t end = (uint64_t)replay->to > UINT64_MAX - first ? UINT64_MAX : first + (uint64_t)replay->to;

    *last = replay->origin;
    while ((result = mcap_next(replay->reader, &message)) > 0) {
        if (program_stopping())
            return false;
        if (message.log_time < replay->origin)
            continue;
        if (message.log_time > end)
            break;
        if (!play(replay, &message, &stepped))
            return false;
        *last = message.log_time;
    }
    if (result < 0) {
        say("%s: cannot be read: %s", replay->path, strerror(-result));
        replay->status = EXIT_FAILED;
    }
    return result >= 0;
}

static void play_all(struct replay *replay) {
    uint64_t first, end, last;

    mcap_times(replay->reader, &first, &end);
    replay->origin = replay->from >= 0 || (uint64_t)-replay->from < first ? first + (uint64_t)replay->from : 0;
    if (!wait_for_readers(replay))
        return;
    replay->patient = !replay->speed.num && !replay->step && replay->readers;
    replay->begin = ddx_time_now() + (replay->clock ? AHEAD_NS : 0);
    do {
        int error = write_clock(replay);

        if (error) {
            say("%s: %s", replay->clock, ddx_error_text(error));
            replay->status = EXIT_FAILED;
            return;
        }
        mcap_rewind(replay->reader);
        if (!play_pass(replay, first, &last))
            return;
        replay->begin = (replay->speed.num && !replay->step ? due_time(replay, last) : ddx_time_now()) + LOOP_NS;
    } while (replay->loop && last > replay->origin);
    struct mcap_state state = mcap_state(replay->reader);
    if (state.damaged)
        say("%s: %u of %u chunks are damaged, their values are missing", replay->path, state.damaged, state.chunks);
}

static int open_items(struct replay *replay) {
    if (!program_attach(&replay->program, replay->book, replay->id, NULL))
        return EXIT_FAILED;
    if (!items_create(replay)) {
        say("%s: holds no items; it was not written by ddxlog, or is empty", replay->path);
        return EXIT_USAGE;
    }
    if (replay->clock) {
        replay->clock_item =
            ddx_store_lookup_item(replay->id, replay->clock, "DDX_REPLAY_CLOCK", (int)sizeof(DDX_REPLAY_CLOCK));
        if (!replay->clock_item) {
            say("-clock %s: %s", replay->clock, ddx_error_text(-errno));
            return EXIT_FAILED;
        }
    }
    return EXIT_OK;
}

static void say_state(const struct replay *replay) {
    struct mcap_state state = mcap_state(replay->reader);
    char error[MCAP_ERROR_MAX];

    if (!state.complete)
        say("%s: is truncated, or still being written: %u whole chunks, %" PRIu64 " bytes after them", replay->path,
            state.chunks, state.left_over);
    if (mcap_refused_text(&state, error))
        say("%s: %s", replay->path, error);
}

int replay_run(struct replay *replay) {
    char error[MCAP_ERROR_MAX];

    replay->reader = mcap_open(replay->path, error);
    if (!replay->reader) {
        say("%s: %s", replay->path, error);
        return EXIT_USAGE;
    }
    say_state(replay);
    const char *offset = mcap_metadata(replay->reader, "ddxlog", "wall_offset_ns");
    replay->wall_offset = offset ? strtoll(offset, NULL, 10) : 0;
    replay->book = program_book(&replay->program, reasons);
    replay->id = program_connect(&replay->program);
    if (replay->id)
        replay->status = open_items(replay);
    if (replay->id && !replay->status)
        play_all(replay);
    program_report(replay->book);
    ddx_stats_close(replay->book);
    ddx_store_done_item(replay->clock_item);
    items_free(replay);
    ddx_store_close(replay->id);
    mcap_close(replay->reader);
    return replay->status;
}
