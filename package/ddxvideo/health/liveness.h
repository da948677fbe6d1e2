/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Which services are alive. runsv knows which ones run (/run/service/<name>/supervise); a program is alive if it writes
 * its item `<name>.stats`, as every program does once a second, and the store if it answers.
 *
 * Silence is counted in this program's own running time, from check to check: if the machine, or the host of a virtual
 * one, stops all programs, none of them counts as dead.
 */
#ifndef DDXHEALTH_LIVENESS_H
#define DDXHEALTH_LIVENESS_H

#include <ddx.h>
#include <stdbool.h>

#define WATCH_STORE "store" /* the service whose sign of life is its answer */
#define WATCH_MAX 32        /* services */

struct watched {
    char name[DDX_NAME_MAX + 1];
    int32_t pid;    /* 0: does not run now */
    bool down;      /* it is not meant to run */
    uint64_t signs; /* of life, as counted by its item */
    bool began;     /* gave one since it runs with this pid: only then silence means something */
    int64_t silent; /* ns since the last one */
    unsigned kills; /* since it runs with this pid: more than one if the first was no help */
    bool seen;      /* in the folder, in this look */
};

struct liveness {
    struct watched service[WATCH_MAX];
    unsigned count;
    bool answered;   /* the store did, in the last look */
    int64_t refused; /* ns that the store let us wait for nothing, in a row */
};

/* Look at all services below `folder`, and at the items of the store; waits for its answer, 5 s at most. */
void liveness_look(struct liveness *liveness, const char *folder, DDX_STORE_ID *id);

/* The service of this name, or NULL. */
struct watched *liveness_find(const struct liveness *liveness, const char *name);

/* It runs, and is expected to, but has been silent for `limit` ns. */
bool liveness_is_silent(const struct liveness *liveness, const struct watched *service, int64_t limit);

/* Have runsv kill it; runsv starts it again, and counts. 0 or -errno. */
int liveness_kill(struct watched *service, const char *folder);

#endif
