/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Processes that are clients, as the kernel tells them apart: what each gets, on all of its connections together. */
#ifndef STORE_PROCESS_H
#define STORE_PROCESS_H

#include "state.h"

/* One connection more. NULL: no memory. */
struct process *process_join(struct store *store, int32_t pid);

/* One connection less. The process is dropped when it has none left, and no checkpointed memory. */
void process_leave(struct process *process);
void processes_sweep(struct store *store);

/* Log once that the process has reached its share of checkpointed memory, if it asked for more. */
void process_report(struct process *process);

/* How many of its messages may still be handled in this turn of the worker; then that it was one. */
unsigned process_share(const struct process *process, uint32_t turn);
void process_heard(struct process *process, uint32_t turn);

#endif
