/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "replay.h"

#include <ddx_stats.h>
#include <errno.h>
#include <fnmatch.h>
#include <form.h>
#include <inttypes.h>
#include <mcap.h>
#include <poll.h>
#include <program.h>
#include <replay_clock.h>
#include <schedule.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ddx_time.h"

/* ---- The items that a replay writes ---- */

/* One for each topic; its layout may change from channel to channel. */
struct replay_item {
    struct replay_item *next;
    const char *topic;
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *handle;
    struct form *form; /* of the item's current layout */
    uint16_t channel;  /* the channel that has this layout; 0: none */
    bool refused;      /* reported and left out, for example because another program writes it */
};

#define EXTENTS_MAX 16
#define CLEARED_MAX (64u << 10) /* the padding of smaller values is zeroed */

static void refuse(struct replay_item *item, int error) {
    if (!item->refused)
        say("%s: %s; it is not replayed%s", item->name, ddx_error_text(error),
            error == -EEXIST ? " (-prefix gives the items other names)" : "");
    item->refused = true;
}

/* Create an item of a type of which only the size is known. */
static int create_opaque(struct replay *replay, struct replay_item *item, const char *type, size_t size) {
    void *data;

    item->handle = ddx_store_lookup_item(replay->id, item->name, type, (int)size);
    if (!item->handle)
        return -errno;
    int error = ddx_store_loan(item->handle, &data); /* become its writer */
    return error ? error : ddx_store_cancel(item->handle);
}

static int create(struct replay *replay, struct replay_item *item, const struct mcap_channel *channel, size_t size) {
    const char *type = mcap_value(channel, "ddx.type"), *declaration = mcap_value(channel, "ddx.declaration");
    const char *words = mcap_value(channel, "ddx.extents");
    struct ddx_extent extents[EXTENTS_MAX];
    char *text = strdup(words ? words : "");

    if (!text)
        return -ENOMEM;
    ddx_store_done_item(item->handle);
    form_free(item->form);
    item->handle = NULL;
    item->form = NULL;
    item->channel = 0;
    int error;
    if (*declaration) {
        struct ddx_item_spec spec = {.name = item->name, .type = type, .declaration = declaration, .extents = extents};

        spec.extent_count = form_list_extents(text, extents, EXTENTS_MAX);
        error = ddx_store_create(replay->id, &spec, &item->handle);
    } else {
        error = size > FORM_HEADER ? create_opaque(replay, item, type, size - FORM_HEADER) : -EINVAL;
    }
    free(text);
    if (!error)
        error = form_of_item(item->handle, &item->form);
    if (!error)
        item->channel = channel->id;
    return error;
}

static struct replay_item *find_item(struct replay *replay, const struct mcap_channel *channel) {
    struct replay_item **link = &replay->items;

    for (; *link; link = &(*link)->next)
        if (!strcmp((*link)->topic, channel->topic))
            return *link;
    struct replay_item *item = calloc(1, sizeof *item);
    if (!item)
        return NULL;
    item->topic = channel->topic;
    if (snprintf(item->name, sizeof item->name, "%s%s", replay->prefix, item->topic) >= (int)sizeof item->name) {
        item->name[DDX_NAME_MAX] = 0;
        refuse(item, -EINVAL);
    }
    return *link = item;
}

static bool is_excepted(const struct replay *replay, const char *topic) {
    char pattern[DDX_NAME_MAX + 1];

    for (const char *at = replay->except; at && *at;) {
        size_t length = strcspn(at, ",");

        snprintf(pattern, sizeof pattern, "%.*s", (int)(length > DDX_NAME_MAX ? DDX_NAME_MAX : length), at);
        if (!fnmatch(pattern, topic, 0))
            return true;
        at += length + (at[length] == ',');
    }
    return false;
}

static bool is_ours(const struct replay *replay, const struct mcap_channel *channel) {
    return channel && mcap_value(channel, "ddx.type") && mcap_value(channel, "ddx.declaration") &&
           !is_excepted(replay, channel->topic);
}

/* Create all items of the log. Returns their number. */
static unsigned items_create(struct replay *replay) {
    unsigned count = 0;

    for (unsigned id = 1; id < 65536; id++) {
        const struct mcap_channel *channel = mcap_channel(replay->reader, (uint16_t)id);
        struct replay_item *item = is_ours(replay, channel) ? find_item(replay, channel) : NULL;

        if (!item || item->channel || item->refused)
            continue;
        count++;
        int error = *mcap_value(channel, "ddx.declaration") ? create(replay, item, channel, 0) : 0;
        if (error)
            refuse(item, error);
    }
    return count;
}

static void items_free(struct replay *replay) {
    for (struct replay_item *item = replay->items, *next; item; item = next) {
        next = item->next;
        ddx_store_done_item(item->handle);
        form_free(item->form);
        free(item);
    }
}

static int write_value(const struct replay_item *item, const struct mcap_message *message, int64_t time) {
    void *data;

    if (message->size != item->form->message_size)
        return -EMSGSIZE;
    int error = ddx_store_loan(item->handle, &data);
    if (error)
        return error;
    if (item->form->item_size <= CLEARED_MAX && !*item->form->extents)
        memset(data, 0, (size_t)item->form->item_size);
    form_unpack(item->form, message->data, data);
    return ddx_store_publish(item->handle, &time);
}

/*
 * Write a message with this time. Returns its item. NULL, *error 0: not written by ddxlog, or excepted. NULL, *error
 * -errno: writing failed; reported once for each item.
 */
static struct replay_item *items_write(struct replay *replay, const struct mcap_message *message, int64_t time,
                                       int *error) {
    const struct mcap_channel *channel = mcap_channel(replay->reader, message->channel);
    struct replay_item *item = is_ours(replay, channel) ? find_item(replay, channel) : NULL;

    *error = 0;
    if (!item)
        return NULL;
    if (item->refused) {
        *error = -EEXIST;
        return NULL;
    }
    if (item->channel != channel->id)
        *error = create(replay, item, channel, message->size);
    if (!*error && replay->patient)
        program_wait_for_room(item->handle, &replay->patient, replay->book);
    if (!*error)
        *error = write_value(item, message, time);
    while (program_try_again(*error, replay->book)) /* a replay can wait */
        *error = write_value(item, message, time);
    if (*error) {
        refuse(item, *error);
        return NULL;
    }
    return item;
}

/* The least number of readers that an item has. */
static int items_readers(const struct replay *replay) {
    int least = INT32_MAX;

    for (const struct replay_item *item = replay->items; item; item = item->next) {
        int readers = item->handle && !item->refused ? ddx_store_readers(item->handle) : INT32_MAX;

        if (readers < least)
            least = readers;
    }
    return least;
}

/* ---- The replay ---- */

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
