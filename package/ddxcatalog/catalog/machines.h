/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Which other machines there are, and what they are called here. In the order in which they were heard. */
#ifndef DDXCATALOG_MACHINES_H
#define DDXCATALOG_MACHINES_H

#include <offset.h>

#include "identity.h"

struct machine {
    uint64_t id;
    char called[NAME_MACHINE]; /* what it calls itself */
    char host[NAME_MACHINE];   /* its host name */
    char name[NAME_MACHINE];   /* what it is called here, where others call themselves so, too */
    bool away;                 /* it is not heard */
    unsigned items;            /* that are known of it; kept by the directory */
    /* Kept by the clock: its newest time stamps, and how far its clock is from this one's. */
    int64_t stamp_sent, stamp_received;
    struct offset offset;
    unsigned asked;
};

struct machines {
    struct machine list[NETWORK_MACHINES];
    unsigned count;
};

/* The machine of a record, as the record says it; NULL: no proper names, or no room. */
struct machine *machines_take(struct machines *machines, const struct identity *own,
                              const struct network_record *record);

/* This machine has another name than before. */
void machines_renamed(struct machines *machines, const struct identity *own);

/* NULL: not known. Valid until one is taken or dropped. */
struct machine *machines_find(struct machines *machines, uint64_t id);

/* The machine that is called so here, and is heard; NULL if there is none. `length` bytes of `name` count. */
const struct machine *machines_named(const struct machines *machines, const char *name, size_t length);

/* The machine is not heard any more. */
void machines_away(struct machines *machines, const struct identity *own, uint64_t id);

/* Forget it. */
void machines_drop(struct machines *machines, const struct identity *own, uint64_t id);

/*
 * One that is away and can be forgotten: a machine that is heard calls itself so, it has started again; or there is no
 * room for another one. NULL if there is none.
 */
const struct machine *machines_superseded(const struct machines *machines);

/* How many others have the host name of this one. */
unsigned machines_of_host(const struct machines *machines, const struct identity *own);

#endif
