/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Which items other machines have, as they say. Anything may come from the network, so each record is judged here. */
#ifndef DDXCATALOG_DIRECTORY_H
#define DDXCATALOG_DIRECTORY_H

#include "state.h"
#include "machines.h"

struct remote {
    struct remote *next;
    uint64_t machine;
    char item[DDX_NAME_MAX + 1];
    char *topic, *declaration, *extents;
    struct form *form; /* of a message; the item's own layout is another matter */
    int64_t since;     /* when the machine's catalog was started, which counts its messages from then on */
    uint64_t version;  /* changes when what is said of the item changes */
    bool away;         /* the machine is not heard */
};

struct directory;

/* NULL: no memory. */
struct directory *directory_open(struct catalog *catalog);
void directory_close(struct directory *directory);

/* A record has come, as network_take_record. */
void directory_take(struct directory *directory, const struct network_record *record, enum network_change change);

/* Which machines there are: the directory's. */
struct machines *directory_machines(struct directory *directory);

/* Calls `take` for each item of other machines. */
typedef void directory_each_take(void *argument, const struct machine *machine, const struct remote *remote);
void directory_each(struct directory *directory, directory_each_take *take, void *argument);

/* How many records there were that no catalog sends, or for which there was no room. */
uint64_t directory_refused(const struct directory *directory);

/*
 * "carol:gps". *found is valid until the next directory_take(); NULL for "carol:", the machine. -EHOSTUNREACH: no such
 * machine, or it is away; -ENOENT: it has no such item; -EINVAL: no such name.
 */
int directory_find(const struct directory *directory, const char *name, const struct remote **found);

#endif
