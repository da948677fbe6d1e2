/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "epoch.h"
#include "files.h"
#include "checkpoint.h"
#include "retired.h"

static bool in_use(int watch) {
    return ddx_memory_shared(watch) || ddx_memory_held(watch);
}

static bool known(const struct store *store, int watch) {
    for (const struct retired *retired = store->retired; retired; retired = retired->next)
        if (ddx_memory_same(retired->watch, watch))
            return true;
    return false;
}

void epoch_retire(struct item *item, struct epoch *epoch) {
    struct store *store = item->store;
    /* Charged to no client: the process that causes the change of epoch is not the one that still maps it. */
    struct checkpoint_payer client = checkpoint_charge(NULL, 0);
    struct retired *retired = epoch && epoch->control_fd >= 0 ? checkpoint_allocate(sizeof *retired) : NULL;

    checkpoint_charge(client.account, client.most);
    int watch = retired ? ddx_memory_watch(epoch->control_fd) : -1;

    if (watch >= 0) {
        uint64_t bytes = ddx_page_round(sizeof(struct ddx_control)) + epoch->slots * epoch->runs.file_bytes;

        *retired = (struct retired){store->retired, item, bytes, watch};
    }
    epoch_free(epoch); /* the store's own descriptors and mappings must not count */
    if (watch >= 0 && in_use(watch) && !known(store, watch)) {
        store->retired = retired;
        return;
    }
    if (watch >= 0)
        file_close(watch);
    checkpoint_free(retired);
}

uint64_t retired_bytes(const struct store *store, const struct item *item) {
    uint64_t sum = 0;

    for (const struct retired *retired = store->retired; retired; retired = retired->next)
        if (retired->item == item)
            sum += retired->bytes;
    return sum;
}

void retired_sweep(struct store *store) {
    struct retired **link = &store->retired;

    while (*link) {
        struct retired *retired = *link;

        if (in_use(retired->watch)) {
            link = &retired->next;
            continue;
        }
        *link = retired->next;
        file_close(retired->watch);
        checkpoint_free(retired);
    }
}

void retired_forget(const struct item *item) {
    for (struct retired *retired = item->store->retired; retired; retired = retired->next)
        if (retired->item == item)
            retired->item = NULL;
}
