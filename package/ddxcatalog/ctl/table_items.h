/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What the catalog says of itself, in two items of its store, and `ddxctl catalog` shows. */
#ifndef DDXCATALOG_TABLE_ITEMS_H
#define DDXCATALOG_TABLE_ITEMS_H

#include <ddx.h>

#define TABLE_MACHINES "catalog.machines"
#define TABLE_ITEMS "catalog.items"
#define TABLE_ITEMS_MAX 512 /* that are listed */

/* No padding: a 32-bit program reads the same. */
DDX_STORE_TYPE(
    CATALOG_MACHINES, struct {
        char name[40]; /* of this machine, as others call it; "" when no catalog runs */
        char host[40]; /* its host name */
        uint32_t same; /* other machines that have this host name */
        uint32_t count;
        uint64_t refused; /* records that no catalog sends, or for which there was no room */
        struct {
            char name[40]; /* as it is called here */
            char host[40];
            uint64_t id;
            int64_t offset; /* its CLOCK_MONOTONIC minus that of this machine, ns */
            int64_t bound;  /* how far off that may be, ns; -1: not known yet */
            uint32_t heard; /* 0: it is away */
            uint32_t items;
        } machine[32]; /* NETWORK_MACHINES */
    });

DDX_STORE_TYPE(
    CATALOG_ITEMS, struct {
        uint32_t known;
        uint32_t count; /* of these, that are listed */
        struct {
            char name[104]; /* "gps", which other machines may read; "carol:gps" of another machine */
            char type[64];
            uint32_t heard;   /* 0: its machine is away */
            uint32_t readers; /* programs of other machines that read it; of "carol:gps" 0, since those are local */
        } item[TABLE_ITEMS_MAX];
    });

#endif
