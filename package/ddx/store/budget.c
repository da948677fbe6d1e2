/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "budget.h"

#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "checkpoint.h"
#include "files.h"
#include "items.h"
#include "log.h"

/* ---- Processes ---- */

#define SHARE 16 /* messages of one process handled in a turn, so that others get theirs */

struct process *process_join(struct store *store, int32_t pid) {
    struct process *process = store->processes;

    while (process && (process->pid != pid || !process->clients)) /* a dead process may have had the same number */
        process = process->next;
    if (!process) {
        if (!(process = checkpoint_allocate(sizeof *process)))
            return NULL;
        process->pid = pid;
        process->next = store->processes;
        store->processes = process;
    }
    process->clients++;
    return process;
}

void process_leave(struct process *process) {
    process->clients--;
}

void processes_sweep(struct store *store) {
    struct process **link = &store->processes;

    while (*link) {
        struct process *process = *link;

        if (process->clients || process->account.bytes) {
            link = &process->next;
            continue;
        }
        *link = process->next;
        checkpoint_free(process);
    }
}

void process_report(struct process *process) {
    if (!process->account.refused || process->is_reported)
        return;
    process->is_reported = true;
    log_line("%d is refused: the names, types and messages that the store keeps for it take %zu KiB, and one program "
             "gets no more; it has to close some of its items",
             (int)process->pid, CHECKPOINT_SHARE >> 10);
}

unsigned process_share(const struct process *process, uint32_t turn) {
    unsigned heard = process->turn == turn ? process->heard : 0;

    return heard < SHARE ? SHARE - heard : 0;
}

void process_heard(struct process *process, uint32_t turn) {
    if (process->turn != turn)
        process->heard = 0;
    process->turn = turn;
    process->heard++;
}

/* ---- Leftovers ---- */

/* Items that no client has open: they remain readable until other items need their memory or their descriptors. */

#define BOOK "DDX_STATS" /* see ddx_stats.h */

static bool is_left(const struct item *item, const struct item *except) {
    return !item->handles && item != except;
}

static bool has_descriptor_below(const struct item *item, int below) {
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

/*
 * The item to drop first: the one written longest ago; counters only if no other item is left, because they record the
 * frames that a dead program has lost. Not `except` (or NULL), which needs the room; `below`: only an item with a
 * descriptor below this number; `payer`: only an item charged to this account (NULL: any). NULL: there is none.
 */
static struct item *leftover_first(const struct store *store, const struct item *except, int below,
                                   const struct checkpoint_account *payer) {
    struct item *found = NULL;
    int64_t oldest = INT64_MAX;
    bool found_book = false;

    for (struct item *item = store->items; item; item = item->next) {
        struct ddx_ring_frame frame = {.time = 0};

        if (!is_left(item, except) || !has_descriptor_below(item, below) || !is_paid_by(item, payer))
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

/* Memory and descriptors that dropping all of these items would free. */
static uint64_t leftover_bytes(const struct store *store, const struct item *except) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        if (is_left(item, except))
            sum += item_reserved(item);
    return sum;
}

static unsigned leftover_files(const struct store *store, const struct item *except) {
    unsigned sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        if (is_left(item, except) && item->epoch)
            sum += item->epoch->slots + 1 + (item->epoch->readers_fd >= 0) + (item->notice_fd >= 0);
    return sum;
}

/* Drop the item because `whom` needs `what` (for the log). Commits, which closes the item's files. */
static void leftover_drop(struct item *victim, const char *what, const char *whom) {
    log_line("%s: dropped, no program has it open and its %s needed for %s", victim->name, what, whom);
    epoch_retire(victim, victim->epoch);
    victim->epoch = NULL;
    item_drop_if_unused(victim);
    files_commit();
}

/* ---- Descriptors ---- */

/* If frames are small, descriptors run out before memory does: then items that no client has open are dropped. */

#define WANTED_MAX (DDX_SLOTS_MAX + 8u) /* an item's frames and its other files */
#define NEEDED "descriptors are"

/* Number of free descriptors, up to `wanted`. */
static unsigned count_free(unsigned wanted) {
    int fd[WANTED_MAX];
    unsigned count = 0;

    while (count < wanted && (fd[count] = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0)) >= 0)
        count++;
    for (unsigned i = 0; i < count; i++)
        close(fd[i]);
    return count;
}

bool descriptors_for_item(struct item *item, unsigned count) {
    const struct store *store = item->store;
    unsigned wanted = count < WANTED_MAX ? count : WANTED_MAX, found;
    struct item *victim;

    while ((found = count_free(wanted)) < wanted && found + leftover_files(store, item) >= wanted &&
           (victim = leftover_first(store, item, INT_MAX, NULL)))
        leftover_drop(victim, NEEDED, item->name);
    return found >= wanted;
}

bool descriptors_below(struct store *store, int number) {
    struct item *victim = leftover_first(store, NULL, number, NULL);

    if (victim)
        leftover_drop(victim, NEEDED, "a connection");
    return victim != NULL;
}

/* ---- Memory ---- */

#define REQUEST 65536u /* bytes of checkpointed memory that one request may take */

uint64_t budget_used(struct store *store) {
    uint64_t sum = 0;

    retired_sweep(store);
    for (const struct item *item = store->items; item; item = item->next)
        sum += item_bytes(item) + retired_bytes(store, item);
    return sum + retired_bytes(store, NULL);
}

uint64_t budget_reserved(const struct store *store) {
    uint64_t sum = 0;

    for (const struct item *item = store->items; item; item = item->next)
        sum += item_reserved(item);
    return sum + retired_bytes(store, NULL);
}

bool budget_allows(struct item *item, uint64_t reserved) {
    struct store *store = item->store;

    for (;;) {
        retired_sweep(store);
        uint64_t others = budget_reserved(store) - item_reserved(item);

        if (others + reserved <= store->settings->budget)
            return true;
        if (others - leftover_bytes(store, item) + reserved > store->settings->budget)
            return false; /* even dropping all of them would not be enough */
        struct item *victim = leftover_first(store, item, INT_MAX, NULL);
        if (!victim)
            return false;
        leftover_drop(victim, "memory is", item->name);
    }
}

void budget_make_room(struct store *store, const struct process *process) {
    char whom[32];
    struct item *victim;

    snprintf(whom, sizeof whom, "process %d", (int)process->pid);
    while (process->account.bytes > CHECKPOINT_SHARE - REQUEST &&
           (victim = leftover_first(store, NULL, INT_MAX, &process->account)))
        leftover_drop(victim, "share of the store's memory is", whom);
}
