/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef WORKER_OF_H
#define WORKER_OF_H

#include <stdio.h>
#include <sys/types.h>

/* The one child of a store's holder. 0: there is none now. */
static inline pid_t worker_of(pid_t holder) {
    char path[64];
    int pid = 0;

    snprintf(path, sizeof path, "/proc/%d/task/%d/children", (int)holder, (int)holder);
    FILE *file = fopen(path, "re");
    if (file && fscanf(file, "%d", &pid) != 1)
        pid = 0;
    if (file)
        fclose(file);
    return pid;
}

#endif
