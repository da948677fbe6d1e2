/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "process.h"

#include "checkpoint.h"
#include "log.h"

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
