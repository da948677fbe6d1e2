/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The items that other machines announce. Anything may come from the network: each record is checked, and counted. */
#ifndef DDXCATALOG_DIRECTORY_H
#define DDXCATALOG_DIRECTORY_H

#include "state.h"
#include "machines.h"

struct remote {
    struct remote *next;
    uint64_t machine;
    char item[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    char *topic, *declaration, *extents;
    size_t message_size; /* the form itself is made when the item is wanted here: it may need some MiB */
    size_t bytes;        /* memory of this struct and its texts */
    int64_t since;       /* start of the machine's catalog, which numbers its messages from then on */
    uint64_t version;    /* changes when the announcement changes */
    bool away;           /* the machine is not heard */
};

struct directory;

/* NULL: no memory. */
struct directory *directory_open(struct catalog *catalog);
void directory_close(struct directory *directory);

/* Handle a received record; arguments as network_take_record. */
void directory_take(struct directory *directory, const struct network_record *record, enum network_change change);

/* The other machines; owned by the directory. */
struct machines *directory_machines(struct directory *directory);

/* Call `take` for each item of other machines. */
typedef void directory_each_take(void *argument, const struct machine *machine, const struct remote *remote);
void directory_each(struct directory *directory, directory_each_take *take, void *argument);

/* Number of records that were invalid, or for which there was no room, with those that the network refused. */
uint64_t directory_refused(const struct directory *directory);

/* Count records that the network refused, and name one of them; `machine` 0: none has a name. */
void directory_refuse(struct directory *directory, uint64_t count, uint64_t machine, const char *item);

/*
 * Find "carol:gps". *found is valid until the next directory_take(); NULL for "carol:", the machine. -EHOSTUNREACH: no
 * such machine, or it is away; -ENOENT: no such item; -EINVAL: not a name of this form.
 */
int directory_find(const struct directory *directory, const char *name, const struct remote **found);

#endif
