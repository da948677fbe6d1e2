/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Finds out which services are alive. runsv knows which of them run (/run/service/<name>/supervise). A program is alive
 * if it writes its item `<name>.stats`, as each program does once a second; the store is alive if it answers.
 *
 * Silence is counted in this program's own running time, from check to check: if the machine, or the host of a virtual
 * machine, stops all programs, none of them counts as dead.
 */
#ifndef DDXHEALTH_LIVENESS_H
#define DDXHEALTH_LIVENESS_H

#include <ddx.h>
#include <stdbool.h>

#define WATCH_STORE "store" /* the name of the store's service */
#define WATCH_MAX 32        /* services */

struct watched {
    char name[DDX_NAME_MAX + 1];
    int32_t pid;    /* 0: not running */
    bool down;      /* it is disabled */
    uint64_t signs; /* number of the item's last value */
    bool began;     /* a value has come from this pid; before it, silence means nothing */
    int64_t silent; /* ns since the last value */
    unsigned kills; /* of this pid; more than one if the first one had no effect */
    bool seen;      /* in the folder, at this check */
};

struct liveness {
    struct watched service[WATCH_MAX];
    unsigned count;
    bool answered;   /* the store has, at the last check */
    int64_t refused; /* ns of waiting for the store since its last answer */
};

/* Check all services in `folder`, and the items of the store. Waits at most 5 s for its answer. */
void liveness_look(struct liveness *liveness, const char *folder, DDX_STORE_ID *id);

/* The service of this name, or NULL. */
struct watched *liveness_find(const struct liveness *liveness, const char *name);

/* Whether it should run and does, but has been silent for `limit` ns. */
bool liveness_is_silent(const struct liveness *liveness, const struct watched *service, int64_t limit);

/* Let runsv kill it and start it again; counts the kill. 0 or -errno. */
int liveness_kill(struct watched *service, const char *folder);

#endif
