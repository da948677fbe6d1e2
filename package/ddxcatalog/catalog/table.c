/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "table.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <table_items.h>

#include "directory.h"
#include "export.h"

#define PROGRAM "catalog"

_Static_assert(sizeof((CATALOG_MACHINES *)0)->machine / sizeof *((CATALOG_MACHINES *)0)->machine == NETWORK_MACHINES,
               "a line for each machine");

struct table {
    struct catalog *catalog;
    DDX_STORE_ITEM *machines, *items;
    CATALOG_ITEMS written, value;      /* the last value written; the new one */
    CATALOG_MACHINES machines_written; /* without clocks, which always change */
};

static void create(struct table *table, const char *suffix, const char *type, size_t size, DDX_STORE_ITEM **item) {
    char name[DDX_NAME_MAX + 1];

    snprintf(name, sizeof name, "%s%s", PROGRAM, suffix);
    const struct ddx_item_spec spec = {.name = name, .type = type, .size = size};
    program_does_without(PROGRAM, suffix, ddx_store_create(table->catalog->id, &spec, item));
}

struct table *table_open(struct catalog *catalog) {
    struct table *table = calloc(1, sizeof *table);

    if (!table)
        return NULL;
    table->catalog = catalog;
    create(table, TABLE_MACHINES + strlen(PROGRAM), "CATALOG_MACHINES", sizeof(CATALOG_MACHINES), &table->machines);
    create(table, TABLE_ITEMS + strlen(PROGRAM), "CATALOG_ITEMS", sizeof(CATALOG_ITEMS), &table->items);
    return table;
}

static void add_item(struct table *table, const char *machine, const char *name, const char *type, bool heard,
                     unsigned readers) {
    CATALOG_ITEMS *value = &table->value;

    if (value->known++ >= TABLE_ITEMS_MAX)
        return;
    unsigned i = value->count++;
    snprintf(value->item[i].name, sizeof value->item[i].name, "%s%s%s", machine, *machine ? ":" : "", name);
    snprintf(value->item[i].type, sizeof value->item[i].type, "%s", type);
    value->item[i].heard = heard;
    value->item[i].readers = readers;
}

static void add_own(void *argument, const char *name, const char *type, unsigned readers) {
    add_item(argument, "", name, type, true, readers);
}

static void add_remote(void *argument, const struct machine *machine, const struct remote *remote) {
    add_item(argument, machine->name, remote->item, remote->type, !machine->away && !remote->away, 0);
}

static void write_items(struct table *table) {
    memset(&table->value, 0, sizeof table->value);
    exports_each(table->catalog->exports, add_own, table);
    directory_each(table->catalog->directory, add_remote, table);
    if (!table->items || !memcmp(&table->value, &table->written, sizeof table->value))
        return;
    if (!ddx_store_write(table->items, &table->value, NULL))
        table->written = table->value;
}

static void add_machines(const struct table *table, const struct machines *machines, CATALOG_MACHINES *value) {
    const struct identity *own = &table->catalog->identity;

    strcpy(value->name, own->name);
    strcpy(value->host, own->host);
    value->same = machines_of_host(machines, own);
    value->count = machines->count;
    value->refused = directory_refused(table->catalog->directory);
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        strcpy(value->machine[i].name, machine->name);
        strcpy(value->machine[i].host, machine->host);
        value->machine[i].id = machine->id;
        value->machine[i].heard = !machine->away;
        value->machine[i].items = machine->items;
    }
}

static void add_clocks(const struct machines *machines, CATALOG_MACHINES *value) {
    int64_t now = ddx_time_now();

    for (unsigned i = 0; i < machines->count; i++)
        if (!offset_get(&machines->list[i].offset, now, &value->machine[i].offset, &value->machine[i].bound))
            value->machine[i].bound = -1;
}

void table_write(struct table *table, const struct machines *machines, bool clocks) {
    CATALOG_MACHINES value;

    memset(&value, 0, sizeof value);
    add_machines(table, machines, &value);
    if (clocks || memcmp(&value, &table->machines_written, sizeof value)) {
        table->machines_written = value;
        add_clocks(machines, &value);
        if (table->machines)
            ddx_store_write(table->machines, &value, NULL);
    }
    write_items(table);
}

void table_close(struct table *table) {
    CATALOG_MACHINES value;

    if (!table)
        return;
    memset(&value, 0, sizeof value);
    memset(&table->value, 0, sizeof table->value);
    if (table->machines)
        ddx_store_write(table->machines, &value, NULL);
    if (table->items)
        ddx_store_write(table->items, &table->value, NULL);
    ddx_store_done_item(table->machines);
    ddx_store_done_item(table->items);
    free(table);
}
