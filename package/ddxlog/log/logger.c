/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "logger.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <mcap.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "ddx_time.h"
#include "recover.h"

/* ---- Mender ---- */

/* At the start: repair of files that a power cut has truncated. */

/* At the start: repair this instance's files that a power failure has truncated, at idle priority. */

#define IDLE_PRIORITY (3 << 13) /* ioprio_set(): the disk when no other program uses it */

static bool is_ours(const struct logger *logger, const char *name) {
    size_t length = strlen(logger->program.instance), all = strlen(name);

    return !strncmp(name, logger->program.instance, length) && name[length] == '-' && all > 5 &&
           !strcmp(name + all - 5, ".mcap");
}

/* The thread; `argument` is a struct logger. */
static void *mender_run(void *argument) {
    struct logger *logger = argument;

    program_thread_signals();
    program_thread_ordinary();
    /* Both affect only this thread. */
    setpriority(PRIO_PROCESS, (id_t)syscall(SYS_gettid), 19);
    syscall(SYS_ioprio_set, 1, 0, IDLE_PRIORITY);
    DIR *folder = opendir(logger->config.folder);
    struct dirent *entry;
    while (folder && !logger->stopping && (entry = readdir(folder))) {
        char path[PATH_MAX], error[MCAP_ERROR_MAX];
        struct recovery recovery;

        if (!is_ours(logger, entry->d_name) ||
            snprintf(path, sizeof path, "%s/%s", logger->config.folder, entry->d_name) >= (int)sizeof path)
            continue;
        int result = recover(path, &logger->stopping, &recovery, error);
        if (!result)
            say("%s: was truncated; repaired, %llu messages", path, (unsigned long long)recovery.messages);
        if (!result && mcap_refused_text(&recovery.state, error))
            say("%s: %s; the old file is kept as .damaged", path, error);
        if (result && result != -EALREADY && result != -EBUSY && result != -ECANCELED)
            say("%s: %s", path, error);
    }
    if (folder)
        closedir(folder);
    return NULL;
}

/* ---- Finder ---- */

/* The thread that asks the store which items there are. */

/* Finds items to log and opens them. Only this thread waits for answers of the store. */

#define LOOK_NS 50000000             /* between two lists of the store's items */
#define ALONE_NS INT64_C(5000000000) /* without a writer, until an item is closed; longer than a writer's restart */
#define KEEP 16                      /* values that the store keeps for the logger, at first */
#define KEEP_MAX 200
#define KEEP_BYTES (1u << 20)
#define KEEP_PART 2 /* later: the values of a second divided by this */

struct finder {
    struct logger *logger;
    bool looked; /* the first list is done: later new items are logged from their first value on */
    bool full;
    int64_t time; /* of the previous list */
};

static struct item *find_item(struct logger *logger, const char *name) {
    unsigned count = atomic_load(&logger->item_count);

    for (unsigned i = 0; i < count; i++)
        if (!strcmp(logger->items[i]->name, name))
            return logger->items[i];
    return NULL;
}

/*
 * Hold the value to begin with: for an awaited or known item, the first one written since the store has admitted this
 * reader; otherwise, and if there is none, the newest one.
 */
static int hold_first(struct item *item) {
    int error = -ETIMEDOUT;

    item->first.sequence = 0;
    if (item->awaited || item->known)
        error = ddx_store_acquire(item->handle, &item->first, 0, DDX_IN_ORDER);
    return error == -ETIMEDOUT ? ddx_store_acquire(item->handle, &item->first, 0, DDX_CURRENT) : error;
}

/* Open the item, and hold a value. False on failure; the next look tries again. */
static bool open_item(struct finder *finder, struct item *item) {
    unsigned keep = item->rule->period ? 1 : KEEP;

    item->handle = ddx_store_lookup_item(finder->logger->id, item->name, NULL, 0);
    if (!item->handle)
        return false;
    int error;
    for (;; keep /= 2) {
        ddx_store_keep(item->handle, keep);
        error = hold_first(item);
        if (error != -EBUSY || keep < 2)
            break;
    }
    if (error && error != -ETIMEDOUT) {
        if (!item->refused)
            say("%s: %s; it is not logged until that changes", item->name, ddx_error_text(error));
        item->refused = true;
        ddx_store_done_item(item->handle);
        item->handle = NULL;
        return false;
    }
    item->refused = false;
    item->kept = keep;
    atomic_store(&item->keep, keep);
    return true;
}

static void add_item(struct finder *finder, const struct ddx_item_info *info) {
    struct logger *logger = finder->logger;
    const struct config_rule *rule = config_rule_for(&logger->config, info->name, info->type);
    unsigned count = atomic_load(&logger->item_count);

    if (!rule)
        return;
    struct item *item = count < ITEMS_MAX ? calloc(1, sizeof *item) : NULL;
    if (!item) {
        if (!finder->full)
            say("more than %d items: %s and later ones are not logged", ITEMS_MAX, info->name);
        finder->full = true;
        return;
    }
    strcpy(item->name, info->name);
    item->rule = rule;
    item->awaited = finder->looked || !info->sequence;
    item->listed = info->sequence;
    if (!open_item(finder, item)) {
        if (!item->refused) {
            free(item);
            return;
        }
    } else {
        atomic_store(&item->state, ITEM_FOUND);
    }
    logger->items[count] = item;
    atomic_store(&logger->item_count, count + 1);
}

/* Keep as many frames as the item has values in half a second. */
static void choose_keep(struct item *item, const struct ddx_item_info *info, int64_t passed) {
    if (item->rule->period || !info->frame_bytes || passed <= 0 || info->sequence <= item->listed)
        return;
    uint64_t keep = (info->sequence - item->listed) * UINT64_C(1000000000) / KEEP_PART / (uint64_t)passed;
    if (keep > KEEP_MAX)
        keep = KEEP_MAX;
    if (keep > KEEP_BYTES / info->frame_bytes)
        keep = KEEP_BYTES / info->frame_bytes;
    keep = (keep + KEEP - 1) / KEEP * KEEP;
    if (keep > atomic_load(&item->keep))
        atomic_store(&item->keep, (unsigned)keep);
}

/* `info`: the item in the store's list; NULL if it is not there. */
static void look_at(struct finder *finder, struct item *item, const struct ddx_item_info *info, int64_t now) {
    bool alone = !info || !info->writer_pid;
    enum item_state state = atomic_load(&item->state);

    if (!alone)
        item->alone = 0;
    else if (!item->alone)
        item->alone = now;
    if (state == ITEM_READ && info)
        choose_keep(item, info, now - finder->time);
    if (state == ITEM_READ && alone && now - item->alone > ALONE_NS)
        atomic_compare_exchange_strong(&item->state, &state, ITEM_LEAVE);
    if (state == ITEM_ABSENT && info && (!alone || !item->known || info->sequence != atomic_load(&item->consumed)) &&
        open_item(finder, item)) {
        item->alone = 0;
        atomic_store(&item->state, ITEM_FOUND);
    }
    if (info)
        item->listed = info->sequence;
}

static void look(struct finder *finder) {
    struct logger *logger = finder->logger;
    struct ddx_item_info *infos;
    unsigned count, known = atomic_load(&logger->item_count);

    if (ddx_store_list(logger->id, NULL, &infos, &count)) /* the store is away; its items remain as they are */
        return;
    int64_t now = ddx_time_now();
    for (unsigned i = 0; i < known; i++) {
        const struct ddx_item_info *info = NULL;

        for (unsigned k = 0; k < count && !info; k++)
            if (!strcmp(infos[k].name, logger->items[i]->name))
                info = &infos[k];
        look_at(finder, logger->items[i], info, now);
    }
    for (unsigned k = 0; k < count; k++)
        if (!find_item(logger, infos[k].name))
            add_item(finder, &infos[k]);
    free(infos);
    finder->looked = true;
    finder->time = now;
}

/* The thread; `logger` is a struct logger. It exits soon after `stopping`. */
static void *finder_run(void *argument) {
    struct finder finder = {.logger = argument};
    const struct timespec pause = {.tv_nsec = LOOK_NS};

    program_thread_signals();
    program_thread_ordinary();
    while (!finder.logger->stopping) {
        look(&finder);
        clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, NULL);
    }
    return NULL;
}

/* ---- Values of one item ---- */

/* Reading values from the store into the queue: one item after the other, a few microseconds each. */

#define BATCH 256 /* values of one item before the next item's turn */

/* Set the channel for the item's current layout. 0 or -errno. */
static int choose_channel(struct item *item) {
    uint32_t layout = ddx_store_layout(item->handle);

    if (item->channel && layout == item->layout)
        return 0;
    struct form *form;
    int error = form_of_item(item->handle, &form);
    if (error)
        return error;
    struct channel *channel = item->channels;
    while (channel && !form_same(channel->form, form))
        channel = channel->next;
    if (channel) {
        form_free(form);
    } else {
        channel = calloc(1, sizeof *channel);
        if (!channel) {
            form_free(form);
            return -ENOMEM;
        }
        channel->form = form;
        channel->item = item;
        channel->next = item->channels;
        item->channels = channel;
    }
    item->channel = channel;
    item->layout = layout;
    return 0;
}

static void count_lost(struct logger *logger, struct item *item, unsigned reason, uint64_t values) {
    atomic_fetch_add(&item->lost[reason], values);
    ddx_stats_lost(logger->book, reason, values);
}

/* Count missed values: with a rate as skipped, else as lost. */
static void count_missed(struct logger *logger, struct item *item, uint64_t missed) {
    if (!missed)
        return;
    if (item->rule->period) {
        atomic_fetch_add(&item->skipped, missed);
        ddx_stats_skipped(logger->book, missed);
        return;
    }
    atomic_fetch_add(&item->in, missed);
    ddx_stats_in(logger->book, missed, 0);
    count_lost(logger, item, LOST_STORE, missed);
}

static void take_value(struct logger *logger, struct item *item, const struct ddx_frame *frame) {
    atomic_fetch_add(&item->in, 1);
    ddx_stats_in(logger->book, 1, 0);
    item->sequence = frame->sequence;
    atomic_store(&item->consumed, frame->sequence);
    int error = choose_channel(item);
    if (error) {
        if (!item->refused)
            say("%s: its values cannot be logged: %s", item->name, ddx_error_text(error));
        item->refused = true;
        count_lost(logger, item, LOST_STORE, 1);
        return;
    }
    const struct form *form = item->channel->form;
    bool large = form->message_size > MCAP_MESSAGE_MAX;
    struct queue_entry *entry = large ? NULL : queue_place(&logger->queue, form->message_size);
    if (!entry) {
        if (!item->refused)
            say("losing values of %s from %" PRIu64 " on: %s", item->name, frame->sequence,
                large                                     ? "one is larger than what a log can hold (63 MiB)"
                : form->message_size > logger->queue.size ? "one is larger than the queue (queue SIZE in logger.conf)"
                                                          : "the queue is full, the disk is too slow");
        item->refused = true;
        count_lost(logger, item, LOST_QUEUE, 1);
        return;
    }
    item->refused = false;
    entry->item = item;
    entry->channel = item->channel;
    entry->sequence = frame->sequence;
    entry->time = frame->time;
    int64_t now = ddx_time_now();
    entry->logged = frame->time < logger->begin || frame->time > now ? now : frame->time;
    form_pack(form, frame->data, entry->data);
    queue_put(&logger->queue);
}

/* The main thread's work for ITEM_FOUND and ITEM_LEAVE. */
static void item_begin(struct logger *logger, struct item *item) {
    struct ddx_frame *first = &item->first;

    if (first->sequence) {
        bool again = item->known && first->sequence == item->sequence;

        if (item->known && first->sequence > item->sequence)
            count_missed(logger, item, first->sequence - item->sequence - 1);
        else if (!again && (item->known || item->awaited)) /* numbering started again, or the item was awaited */
            count_missed(logger, item, first->sequence - 1);
        if (!again)
            take_value(logger, item, first);
        ddx_store_release(item->handle);
    }
    item->known = true;
    item->due = ddx_time_now() + item->rule->period;
    atomic_store(&item->state, ITEM_READ);
}

static void item_leave(struct item *item) {
    ddx_store_done_item(item->handle);
    item->handle = NULL;
    item->channel = NULL;
    atomic_store(&item->state, ITEM_ABSENT);
}

/* Whether the rate allows a value now. */
static bool is_due(struct item *item) {
    int64_t now = ddx_time_now();

    if (now < item->due)
        return false;
    item->due += item->rule->period; /* a late read does not lower the rate */
    if (item->due <= now)
        item->due = now + item->rule->period;
    return true;
}

/* Queue the new values of one item, without waiting. False if reading failed, so that the item must be closed. */
static bool item_take(struct logger *logger, struct item *item) {
    unsigned keep = atomic_load(&item->keep);

    if (keep > item->kept) {
        ddx_store_keep(item->handle, keep); /* without room in the store, the number remains as it is */
        item->kept = keep;
    }
    int64_t due = item->due;
    if (item->rule->period && !is_due(item))
        return true;
    int tail = item->rule->period ? DDX_NEXT : DDX_IN_ORDER, error = 0;
    for (int i = 0; i < (item->rule->period ? 1 : BATCH); i++) {
        struct ddx_frame frame;

        error = ddx_store_acquire(item->handle, &frame, 0, tail);
        if (error)
            break;
        count_missed(logger, item, frame.missed);
        take_value(logger, item, &frame);
        ddx_store_release(item->handle);
    }
    if (error && item->rule->period)
        item->due = due; /* there was no value: the next one is due at once */
    if (error && error != -ETIMEDOUT) {
        say("%s: %s; it will be tried again", item->name, ddx_error_text(error));
        return false;
    }
    return true;
}

/* ---- Main ---- */

static const char *const reasons[] = {"store", "queue", "write", NULL};

#define POLL_NS INT64_C(5000000)

/* One look at each item. */
static void turn(struct logger *logger) {
    unsigned count = atomic_load(&logger->item_count);

    for (unsigned i = 0; i < count; i++) {
        struct item *item = logger->items[i];
        enum item_state state = atomic_load(&item->state);

        if (state == ITEM_FOUND) {
            item_begin(logger, item);
            state = ITEM_READ; /* take later values now: this turn may be the last one */
        }
        /* Items are read a last time before they are closed. */
        if ((state == ITEM_READ || state == ITEM_LEAVE) && (!item_take(logger, item) || state == ITEM_LEAVE))
            item_leave(item);
    }
}

static void log_items(struct logger *logger) {
    int64_t next = ddx_time_now();

    while (!program_stopping() && !disk_error(logger->disk)) {
        turn(logger);
        program_tick(logger->book);
        int64_t now = ddx_time_now();
        next = next + POLL_NS > now ? next + POLL_NS : now + POLL_NS;
        struct timespec until = {.tv_sec = (time_t)(next / SECOND), .tv_nsec = (long)(next % SECOND)};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    }
}

static void free_items(struct logger *logger) {
    for (unsigned i = 0; i < logger->item_count; i++) {
        struct item *item = logger->items[i];

        ddx_store_done_item(item->handle);
        for (struct channel *channel = item->channels, *next; channel; channel = next) {
            next = channel->next;
            form_free(channel->form);
            free(channel);
        }
        free(item->last.data);
        free(item);
    }
}

/* Start all threads, log until a request to stop, and join the threads. */
static int log_until_stopped(struct logger *logger) {
    pthread_t finder, mender;
    int error = disk_start(logger);

    if (error)
        return EXIT_FAILED;
    bool mends = !pthread_create(&mender, NULL, mender_run, logger);
    error = -pthread_create(&finder, NULL, finder_run, logger);
    if (error)
        say("%s", strerror(-error));
    else
        log_items(logger);
    logger->stopping = true;
    if (!error) {
        pthread_join(finder, NULL);
        turn(logger); /* values written before the request to stop */
    }
    if (mends)
        pthread_join(mender, NULL);
    int failed = disk_stop(logger->disk);
    return error || failed ? EXIT_FAILED : EXIT_OK;
}

int logger_run(struct logger *logger) {
    logger->begin = ddx_time_now();
    logger->book = program_book(&logger->program, reasons);
    ddx_stats_latency_until(logger->book, DDX_STATS_DISK);
    int error = queue_init(&logger->queue, logger->config.queue);
    if (error)
        say("queue: %s", strerror(-error));
    logger->id = error ? NULL : program_connect(&logger->program);
    logger->status = error ? EXIT_FAILED : EXIT_OK;
    if (logger->id)
        logger->status =
            program_attach(&logger->program, logger->book, logger->id, NULL) ? log_until_stopped(logger) : EXIT_FAILED;
    program_report(logger->book);
    ddx_stats_close(logger->book);
    free_items(logger);
    ddx_store_close(logger->id);
    queue_free(&logger->queue);
    return logger->status;
}
