/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "logger.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "disk.h"
#include "finder.h"
#include "mender.h"
#include "read.h"

static const char *const reasons[] = {"store", "queue", "write", NULL};

#define POLL_NS INT64_C(5000000)
#define NS INT64_C(1000000000)

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
        struct timespec until = {.tv_sec = (time_t)(next / NS), .tv_nsec = (long)(next % NS)};
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
        logger->status = program_attach(&logger->program, logger->book, logger->id, NULL) ? log_until_stopped(logger)
                                                                                           : EXIT_FAILED;
    program_report(logger->book);
    ddx_stats_close(logger->book);
    free_items(logger);
    ddx_store_close(logger->id);
    queue_free(&logger->queue);
    return logger->status;
}
