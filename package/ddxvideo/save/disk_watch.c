/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "disk_watch.h"

#include <errno.h>
#include <stdio.h>
#include <time.h>

#include "ddx_time.h"
#include "pool_files.h"
#include "program.h"

#define RATE_PERIOD (5 * SECOND)

struct rate {
    uint64_t out;
    int64_t time;
    uint64_t bytes; /* a second */
};

static void measure(struct disk_watch *watch, struct rate *rate) {
    DDX_STATS stats;
    int64_t now = ddx_time_now(), passed = now - rate->time;

    if (rate->time && passed < RATE_PERIOD && rate->bytes)
        return;
    ddx_stats_get(watch->book, &stats);
    if (rate->time)
        rate->bytes =
            (uint64_t)((double)(stats.out - rate->out) * watch->frame_bytes * (double)SECOND / (double)passed);
    rate->out = stats.out;
    rate->time = now;
}

static void look(struct disk_watch *watch, struct rate *rate) {
    struct free_space room;

    encode_load_measure(watch->load);
    if (free_space_look(watch->place, &room))
        return; /* the old value stays; its time shows its age */
    measure(watch, rate);
    const DDX_DISK disk = {.free = room.free,
                           .usable = room.usable,
                           .rate = rate->bytes,
                           .seconds_left = rate->bytes && !watch->recycle ? (int64_t)(room.usable / rate->bytes) : -1,
                           .ready = room.ready,
                           .recording = !watch->paused,
                           .coarse = watch->load->coarse,
                           .encoding = watch->load->percent};
    ddx_store_write(watch->item, &disk, NULL);
}

static void *run(void *argument) {
    struct disk_watch *watch = argument;
    struct rate rate = {.time = 0};

    program_thread_signals();
    program_thread_ordinary();
    pthread_mutex_lock(&watch->lock);
    while (!watch->stop) {
        struct timespec until;

        pthread_mutex_unlock(&watch->lock);
        look(watch, &rate);
        clock_gettime(CLOCK_MONOTONIC, &until);
        until.tv_sec++;
        pthread_mutex_lock(&watch->lock);
        if (!watch->stop)
            pthread_cond_timedwait(&watch->changed, &watch->lock, &until);
    }
    pthread_mutex_unlock(&watch->lock);
    return NULL;
}

void disk_watch_start(struct disk_watch *watch, DDX_STORE_ID *id, const char *instance) {
    char name[DDX_NAME_MAX + 1];
    const struct ddx_item_spec spec = {.name = name, .type = "DDX_DISK", .size = sizeof(DDX_DISK)};

    pthread_mutex_init(&watch->lock, NULL);
    program_condition(&watch->changed);
    int error = snprintf(name, sizeof name, "%s.disk", instance) <= DDX_NAME_MAX ? 0 : -ENAMETOOLONG;
    if (!error)
        error = ddx_store_create(id, &spec, &watch->item);
    if (!error)
        error = -pthread_create(&watch->thread, NULL, run, watch);
    if (!error)
        return;
    say("%s: cannot publish the state of its disk: %s", instance, ddx_error_text(error));
    ddx_store_done_item(watch->item);
    watch->item = NULL;
}

void disk_watch_stop(struct disk_watch *watch) {
    if (!watch->item)
        return;
    pthread_mutex_lock(&watch->lock);
    watch->stop = true;
    pthread_cond_signal(&watch->changed);
    pthread_mutex_unlock(&watch->lock);
    pthread_join(watch->thread, NULL);
    ddx_store_done_item(watch->item);
    watch->item = NULL;
}
