/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Name and id of this machine in the network. */
#ifndef DDXCATALOG_IDENTITY_H
#define DDXCATALOG_IDENTITY_H

#include <name.h>
#include <network.h>
#include <stdbool.h>
#include <stdint.h>

struct identity {
    uint64_t id; /* changes with each boot */
    char boot[40];
    char host[NAME_MACHINE]; /* the machine's own name */
    char name[NAME_MACHINE]; /* its name for others: the same, or carol-<4 hex> */
    int64_t since;           /* start of this program, ns of wall time */
};

/* Set all but `identity->host`, which the caller has set. `port` distinguishes stores of one machine. */
void identity_begin(struct identity *identity, long port);

/* Whether this machine needs another name, because the record's sender had this name before. True once at most. */
bool identity_is_taken(const struct identity *identity, const struct network_record *record);

/* Take the name carol-<4 hex>. */
void identity_yield(struct identity *identity);

#endif
