/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frames.h"

#include <ddx.h>
#include <ddx_stats.h>
#include <stdlib.h>
#include <string.h>

#define SUFFIX ".stats"
#define TYPE "DDX_STATS"

static bool is_of(const char *instance, const char *program) {
    const size_t length = strlen(program);

    return !strncmp(instance, program, length) && (!instance[length] || instance[length] == '.');
}

/* The item's instance, if it is one of those. */
static bool is_counter(const struct ddx_item_info *item, struct counter *counter) {
    const size_t length = strlen(item->name), suffix = strlen(SUFFIX);

    if (length <= suffix || length - suffix >= WORD_MAX || strcmp(item->name + length - suffix, SUFFIX) != 0 ||
        strcmp(item->type, TYPE) != 0)
        return false;
    *counter = (struct counter){0};
    memcpy(counter->name, item->name, length - suffix);
    counter->kind = is_of(counter->name, "ddxvideosave") ? RECORDER : is_of(counter->name, "ddxlog") ? LOGGER : GRABBER;
    return counter->kind != GRABBER || is_of(counter->name, "ddxvideoV4L") || is_of(counter->name, "ddxvideo1394");
}

static bool read_counter(DDX_STORE_ID *id, const char *name, struct counter *counter) {
    DDX_STATS stats;
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    const bool found =
        item && !strcmp(ddx_store_item_type(item), TYPE) && !ddx_store_read(item, &stats, NULL, 0, DDX_CURRENT);

    if (item)
        ddx_store_done_item(item);
    if (!found)
        return false;
    counter->taken = stats.in;
    counter->passed = counter->kind == GRABBER ? stats.in : stats.out;
    counter->waiting = stats.waiting;
    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats.reasons; i++)
        counter->lost += stats.lost[i].frames;
    return true;
}

void frames_look(struct frames *frames) {
    struct ddx_item_info *items = NULL;
    unsigned count = 0;
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 0);

    *frames = (struct frames){.answered = id && !ddx_store_list(id, NULL, &items, &count)};
    for (unsigned i = 0; i < count && frames->count < COUNTERS_MAX; i++)
        if (is_counter(&items[i], &frames->list[frames->count]) &&
            read_counter(id, items[i].name, &frames->list[frames->count]))
            frames->count++;
    free(items);
    ddx_store_close(id);
}

const struct counter *frames_find(const struct frames *frames, const char *name) {
    for (unsigned i = 0; i < frames->count; i++)
        if (!strcmp(frames->list[i].name, name))
            return &frames->list[i];
    return NULL;
}
