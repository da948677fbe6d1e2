/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <string.h>

#include "files.h"
#include "items.h"
#include "leftover.h"
#include "log.h"
#include "retired.h"

#define BOOK "DDX_STATS" /* see ddx_stats.h */

static bool is_left(const struct item *item, const struct item *except) {
    return !item->handles && item != except;
}

static bool any_below(const struct item *item, int below) {
    const struct epoch *epoch = item->epoch;

    if (item->notice_fd >= 0 && item->notice_fd < below)
        return true;
    if (!epoch)
        return false;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_fd[i] >= 0 && epoch->slot_fd[i] < below)
            return true;
    return epoch->control_fd < below;
}

/* Whether the item is charged to this account (NULL: any). */
static bool is_paid_by(const struct item *item, const struct checkpoint_account *payer) {
    return !payer || checkpoint_account(item) == payer || (item->epoch && checkpoint_account(item->epoch) == payer);
}

struct item *leftover_first(const struct store *store, const struct item *except, int below,
                            const struct checkpoint_account *payer) {
    struct item *found = NULL;
    int64_t oldest = INT64_MAX;
    bool found_book = false;

    for (struct item *item = store->items; item; item = item->next) {
        struct ddx_ring_frame frame = {.time = 0};

        if (!is_left(item, except) || !any_below(item, below) || !is_paid_by(item, payer))
            continue;
        if (item->epoch)
            ddx_ring_peek(item->epoch->control, &frame);
        bool book = !strcmp(item->type, BOOK);
        /* The first one in any case: its frame may have the time INT64_MAX. */
        if (!found || (book != found_book ? found_book : frame.time < oldest)) {
            oldest = frame.time;
            found = item;
            found_book = book;
        }
    }
    return found;
}

uint64_t leftover_bytes(const struct store *store, const struct item *except) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        if (is_left(item, except))
            sum += item_reserved(item);
    return sum;
}

unsigned leftover_files(const struct store *store, const struct item *except) {
    unsigned sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        if (is_left(item, except) && item->epoch)
            sum += item->epoch->slots + 1 + (item->epoch->readers_fd >= 0) + (item->notice_fd >= 0);
    return sum;
}

void leftover_drop(struct item *victim, const char *what, const char *whom) {
    log_line("%s: dropped, no program has it open and its %s needed for %s", victim->name, what, whom);
    epoch_retire(victim, victim->epoch);
    victim->epoch = NULL;
    item_drop_if_unused(victim);
    files_commit();
}
