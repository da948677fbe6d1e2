/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <stdlib.h>
#include <unistd.h>

#include "server.h"

struct retired {
    struct retired *next;
    const struct item *item; /* NULL: it is no more */
    uint64_t bytes;
    int watch; /* a description of the control page that nobody else has */
};

static struct retired *first;

static bool in_use(int watch) {
    return ddx_memory_shared(watch) || ddx_memory_held(watch);
}

static bool known(int watch) {
    for (const struct retired *retired = first; retired; retired = retired->next)
        if (ddx_memory_same(retired->watch, watch))
            return true;
    return false;
}

void epoch_retire(struct item *item, struct epoch *epoch) {
    struct retired *retired = epoch && epoch->control_fd >= 0 ? malloc(sizeof *retired) : NULL;
    int watch = retired ? ddx_memory_watch(epoch->control_fd) : -1;

    if (watch >= 0) {
        uint64_t bytes = ddx_page_round(sizeof(struct ddx_control)) + epoch->slots * epoch->runs.file_bytes;

        *retired = (struct retired){first, item, bytes, watch};
    }
    epoch_free(epoch); /* what we have of it ourselves does not count */
    if (watch >= 0 && in_use(watch) && !known(watch) && !DDX_BROKEN("uncounted")) {
        first = retired;
        return;
    }
    if (watch >= 0)
        close(watch);
    free(retired);
}

uint64_t retired_bytes(const struct item *item) {
    uint64_t sum = 0;

    for (const struct retired *retired = first; retired; retired = retired->next)
        if (retired->item == item)
            sum += retired->bytes;
    return sum;
}

void retired_sweep(void) {
    struct retired **link = &first;

    while (*link) {
        struct retired *retired = *link;

        if (in_use(retired->watch)) {
            link = &retired->next;
            continue;
        }
        *link = retired->next;
        close(retired->watch);
        free(retired);
    }
}

void retired_forget(const struct item *item) {
    for (struct retired *retired = first; retired; retired = retired->next)
        if (retired->item == item)
            retired->item = NULL;
}
