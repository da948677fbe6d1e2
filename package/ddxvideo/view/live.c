/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "live.h"

#include <stdio.h>
#include <string.h>

static struct history *history_of(struct source *source) {
    return &((struct live *)source)->history;
}

static void live_range(struct source *source, int64_t *oldest, int64_t *newest) {
    history_range(history_of(source), oldest, newest);
}

static struct shot *live_take(struct source *source, int64_t position) {
    return history_take(history_of(source), position);
}

static int64_t live_time(struct source *source, int64_t position) {
    return history_time(history_of(source), position);
}

static void live_work(struct source *source) {
    (void)source;
}

static void live_state(struct source *source, struct source_state *state) {
    struct live *live = (struct live *)source;

    *state = (struct source_state){.failed = live->failed,
                                   .lost = history_lost(&live->history),
                                   .rate = history_rate(&live->history, ddx_time_now())};
    pthread_mutex_lock(&live->lock);
    memcpy(state->text, live->text, sizeof state->text);
    pthread_mutex_unlock(&live->lock);
}

bool live_open(struct live *live, const char *name, const struct source_limits *limits, struct surface *surface) {
    live->source = (struct source){.live = true,
                                   .range = live_range,
                                   .take = live_take,
                                   .time = live_time,
                                   .work = live_work,
                                   .state = live_state};
    snprintf(live->source.name, sizeof live->source.name, "%s", name);
    live->surface = surface;
    pthread_mutex_init(&live->lock, NULL);
    return history_open(&live->history, limits->frames, limits->bytes);
}

void live_close(struct live *live) {
    history_close(&live->history);
    pthread_mutex_destroy(&live->lock);
}

void live_add(struct live *live, struct shot *shot) {
    if (!shot->arrival)
        shot->arrival = ddx_time_now();
    history_add(&live->history, shot);
    surface_wake(live->surface);
}

void live_say(struct live *live, const char *text) {
    pthread_mutex_lock(&live->lock);
    bool same = !strcmp(live->text, text);
    snprintf(live->text, sizeof live->text, "%s", text);
    pthread_mutex_unlock(&live->lock);
    if (!same)
        surface_wake(live->surface);
}
