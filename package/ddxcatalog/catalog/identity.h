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

/* Whether another machine that is called so had this machine's own name before this machine. */
bool identity_is_later(const struct identity *identity, const char *called, int64_t since, uint64_t id);

/* Take the name carol-<4 hex>; take the own name again. */
void identity_yield(struct identity *identity);
void identity_return(struct identity *identity);

#endif
