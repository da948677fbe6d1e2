/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "table.h"

#include <stdlib.h>
#include <string.h>

#define ITEM "catalog"
#define SUFFIX ".machines"

/* No padding: a 32-bit program reads the same. */
DDX_STORE_TYPE(
    CATALOG_MACHINES, struct {
        char name[40]; /* of this machine, as others call it; "" when no catalog runs */
        char host[40]; /* its host name */
        uint32_t same; /* other machines that have this host name */
        uint32_t count;
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

_Static_assert(sizeof ((CATALOG_MACHINES *)0)->machine / sizeof *((CATALOG_MACHINES *)0)->machine == NETWORK_MACHINES,
               "a line for each machine");

struct table {
    struct catalog *catalog;
    DDX_STORE_ITEM *item;
};

struct table *table_open(struct catalog *catalog) {
    static const struct ddx_item_spec spec = {.name = ITEM SUFFIX, .type = "CATALOG_MACHINES",
                                              .size = sizeof(CATALOG_MACHINES)};
    struct table *table = calloc(1, sizeof *table);

    if (!table)
        return NULL;
    table->catalog = catalog;
    program_does_without(ITEM, SUFFIX, ddx_store_create(catalog->id, &spec, &table->item));
    return table;
}

void table_write(struct table *table, const struct machines *machines) {
    const struct identity *own = &table->catalog->identity;
    int64_t now = ddx_time_now();
    CATALOG_MACHINES value;

    memset(&value, 0, sizeof value);
    strcpy(value.name, own->name);
    strcpy(value.host, own->host);
    value.same = machines_of_host(machines, own);
    value.count = machines->count;
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        strcpy(value.machine[i].name, machine->name);
        strcpy(value.machine[i].host, machine->host);
        value.machine[i].id = machine->id;
        if (!offset_get(&machine->offset, now, &value.machine[i].offset, &value.machine[i].bound))
            value.machine[i].bound = -1;
        value.machine[i].heard = !machine->away;
        value.machine[i].items = machine->items;
    }
    if (table->item)
        ddx_store_write(table->item, &value, NULL);
}

void table_close(struct table *table) {
    CATALOG_MACHINES value;

    if (!table)
        return;
    memset(&value, 0, sizeof value);
    if (table->item)
        ddx_store_write(table->item, &value, NULL);
    ddx_store_done_item(table->item);
    free(table);
}
