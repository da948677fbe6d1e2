/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The catalog's state in two items of its store, for `ddxctl catalog`. */
#ifndef DDXCATALOG_TABLE_ITEMS_H
#define DDXCATALOG_TABLE_ITEMS_H

#include <ddx.h>

#define TABLE_MACHINES "catalog.machines"
#define TABLE_ITEMS "catalog.items"
#define TABLE_ITEMS_MAX 512 /* in the list */

/* No padding: a 32-bit program reads the same struct. */
DDX_STORE_TYPE(
    CATALOG_MACHINES, struct {
        char name[40]; /* this machine's name for others; "" when no catalog runs */
        char host[40]; /* its host name */
        uint32_t same; /* other machines with this host name */
        uint32_t count;
        uint64_t refused; /* records that were invalid, or too many */
        struct {
            char name[40]; /* its name here */
            char host[40];
            uint64_t id;
            int64_t offset; /* its CLOCK_MONOTONIC minus that of this machine, ns */
            int64_t bound;  /* bound of the error, ns; -1: not known yet */
            uint32_t heard; /* 0: it is away */
            uint32_t items;
        } machine[32]; /* NETWORK_MACHINES */
    });

DDX_STORE_TYPE(
    CATALOG_ITEMS, struct {
        uint32_t known;
        uint32_t count; /* of these, in the list */
        struct {
            char name[104]; /* "gps", an item that other machines may read; "carol:gps", an item of another machine */
            char type[64];
            uint32_t heard;   /* 0: its machine is away */
            uint32_t readers; /* programs of other machines that read it; 0 for "carol:gps", whose readers are local */
        } item[TABLE_ITEMS_MAX];
    });

#endif
