/* SPDX-License-Identifier: GPL-2.0-or-later */
/* State shared by the parts of the catalog. */
#ifndef DDXCATALOG_STATE_H
#define DDXCATALOG_STATE_H

#include <ddx_stats.h>
#include <form.h>
#include <network.h>
#include <program.h>

#include "config.h"
#include "machines.h"

#define ITEMS_MAX NETWORK_ITEMS /* of one machine */
#define MESSAGE_MAX (16u << 20) /* bytes of a value */

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum {
    LOST_STORE,     /* here: overwritten before it was read */
    LOST_BANDWIDTH, /* here: no bandwidth, or readers have not confirmed earlier messages */
    LOST_SIZE,      /* here: larger than MESSAGE_MAX */
    LOST_NETWORK,   /* sent by another machine, but not arrived */
    LOST_TYPE,      /* from another machine, not of the announced type; here: an invalid picture */
    LOST_BUDGET     /* from another machine, and the store has no room */
};

struct catalog {
    struct program program;
    struct config config;
    struct identity identity;
    int64_t settled; /* when its name is announced */
    bool known;      /* its name has been announced */
    int64_t proof;   /* when it takes its own name again, unless the machine that has this name has proven itself */
    DDX_STATS_BOOK *book;
    DDX_STORE_ID *id;
    struct network *network;
    struct network_records *records;
    struct bucket bucket;
    struct exports *exports;
    struct directory *directory;
    struct mirrors *mirrors;
    struct accepts *accepts;
    struct clock *clock;
    struct table *table;
};

#endif
