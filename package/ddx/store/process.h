/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Client processes (by pid), and the share of each, over all of its connections together. */
#ifndef STORE_PROCESS_H
#define STORE_PROCESS_H

#include "state.h"

/* Add a connection. NULL: no memory. */
struct process *process_join(struct store *store, int32_t pid);

/* Remove a connection. A process without connections and checkpointed memory is dropped. */
void process_leave(struct process *process);
void processes_sweep(struct store *store);

/* Log once that the process has reached its share of checkpointed memory, if it asked for more. */
void process_report(struct process *process);

/* How many more of its messages may be handled in this turn of the worker; count a handled one. */
unsigned process_share(const struct process *process, uint32_t turn);
void process_heard(struct process *process, uint32_t turn);

#endif
