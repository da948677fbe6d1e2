/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What this machine is called in the network, and which one it is. */
#ifndef DDXCATALOG_IDENTITY_H
#define DDXCATALOG_IDENTITY_H

#include <name.h>
#include <network.h>
#include <stdbool.h>
#include <stdint.h>

struct identity {
    uint64_t id; /* another one after each boot */
    char boot[40];
    char host[NAME_MACHINE]; /* what the machine is called by itself */
    char name[NAME_MACHINE]; /* what others call it: the same, or carol-<4 hex> */
    int64_t since;           /* when this program was started, ns of wall time */
};

/* `identity->host` is set. `port` tells stores of one machine apart. */
void identity_begin(struct identity *identity, long port);

/* Whether this machine needs another name, since the one that sends the record had this name before. Once at most. */
bool identity_is_taken(const struct identity *identity, const struct network_record *record);

/* Take the name carol-<4 hex>. */
void identity_yield(struct identity *identity);

#endif
