/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finds items to log and opens them. Only this thread waits for answers of the store. */
#include "finder.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "logger_state.h"

#define LOOK_NS 50000000           /* between two lists of the store's items */
#define ALONE_NS INT64_C(5000000000) /* without a writer, until an item is closed; longer than a writer's restart */
#define KEEP 16                    /* values that the store keeps for the logger, at first */
#define KEEP_MAX 200
#define KEEP_BYTES (1u << 20)
#define KEEP_PART 2 /* later: the values of a second divided by this */

struct finder {
    struct logger *logger;
    bool looked; /* the first list is done: later new items are logged from their first value on */
    bool full;
    int64_t time; /* of the previous list */
};

static struct item *find(struct logger *logger, const char *name) {
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
        if (!find(logger, infos[k].name))
            add_item(finder, &infos[k]);
    free(infos);
    finder->looked = true;
    finder->time = now;
}

void *finder_run(void *argument) {
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
