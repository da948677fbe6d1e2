/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "watch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ddx_time.h"
#include "program.h"

#define PAUSE_NS INT64_C(400000000) /* between two checks */

static const struct ddx_item_info *find_info(const struct ddx_item_info *items, unsigned count, const char *name) {
    for (unsigned i = 0; i < count; i++)
        if (!strcmp(items[i].name, name))
            return &items[i];
    return NULL;
}

/* Finds the counters of the item's writer: those of the same process. */
static const struct ddx_item_info *find_counters(const struct ddx_item_info *items, unsigned count, int32_t pid) {
    for (unsigned i = 0; i < count; i++)
        if (!strcmp(items[i].type, "DDX_STATS") && items[i].writer_pid == pid)
            return &items[i];
    return NULL;
}

static void open_counters(struct watch *watch, const char *name) {
    if (watch->counters && !strcmp(ddx_store_item_name(watch->counters), name))
        return;
    ddx_store_done_item(watch->counters);
    watch->counters = ddx_store_lookup_item(watch->id, name, NULL, 0);
}

static void count_losses(struct watch *watch, struct watch_view *view) {
    if (!watch->counters || ddx_store_read(watch->counters, &watch->value, NULL, 0, DDX_CURRENT))
        return;
    view->counted = true;
    for (unsigned i = 0; i < watch->value.reasons && i < DDX_STATS_REASONS; i++)
        view->lost += watch->value.lost[i].frames;
}

static struct watch_view judge(struct watch *watch, const struct ddx_item_info *items, unsigned count) {
    struct watch_view view = {.state = WATCH_NO_ITEM};
    const struct ddx_item_info *item = find_info(items, count, watch->name), *counters;

    if (!item)
        return view;
    view.state = strcmp(item->type, "DDX_VIDEO") ? WATCH_NO_VIDEO : item->writer_pid ? WATCH_WRITTEN : WATCH_NO_WRITER;
    counters = item->writer_pid ? find_counters(items, count, item->writer_pid) : NULL;
    if (counters)
        open_counters(watch, counters->name);
    count_losses(watch, &view);
    return view;
}

static struct watch_view ask(struct watch *watch) {
    struct watch_view view = {.state = WATCH_NO_STORE};
    struct ddx_item_info *items;
    unsigned count;

    if (!watch->id)
        watch->id = ddx_store_open(NULL, (int)watch->port, 0);
    if (watch->id && !ddx_store_list(watch->id, NULL, &items, &count)) {
        view = judge(watch, items, count);
        free(items);
    }
    return view;
}

/* False: a stop is requested. */
static bool pause_then(struct watch *watch, struct watch_view view) {
    int64_t until = ddx_time_now() + PAUSE_NS;
    struct timespec deadline = {.tv_sec = (time_t)(until / SECOND), .tv_nsec = (long)(until % SECOND)};

    pthread_mutex_lock(&watch->lock);
    view.since = view.state == watch->view.state && watch->view.since ? watch->view.since : ddx_time_now();
    watch->view = view;
    while (!watch->stop && pthread_cond_timedwait(&watch->stopped, &watch->lock, &deadline) != ETIMEDOUT) {
    }
    bool stop = watch->stop;
    pthread_mutex_unlock(&watch->lock);
    return !stop;
}

static void *run(void *argument) {
    struct watch *watch = argument;

    program_thread_signals();
    while (pause_then(watch, ask(watch))) {
    }
    ddx_store_done_item(watch->counters);
    ddx_store_close(watch->id);
    return NULL;
}

int watch_start(struct watch *watch) {
    pthread_mutex_init(&watch->lock, NULL);
    program_condition(&watch->stopped);
    return -pthread_create(&watch->thread, NULL, run, watch);
}

void watch_stop(struct watch *watch) {
    pthread_mutex_lock(&watch->lock);
    watch->stop = true;
    pthread_cond_signal(&watch->stopped);
    pthread_mutex_unlock(&watch->lock);
    pthread_join(watch->thread, NULL);
}

struct watch_view watch_look(struct watch *watch) {
    pthread_mutex_lock(&watch->lock);
    struct watch_view view = watch->view;
    pthread_mutex_unlock(&watch->lock);
    return view;
}
