/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxctl catalog: lists the other machines and their items. */
#include <ddx.h>
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "table_items.h"

#define STORE_WAIT 1.0 /* s */

static const char usage[] = "  catalog [--json]\n"
                            "                other machines, clocks and items, and readers of items of this machine\n";

static CATALOG_MACHINES machines;
static CATALOG_ITEMS items;

static int failed(const char *what) {
    fprintf(stderr, "ddxctl: catalog: %s\n", what);
    return 1;
}

/* Readers of line `line`: on this machine for an item of another one, on other machines for an item of this one. */
static unsigned readers_of(uint32_t line, const struct ddx_item_info *all, unsigned count) {
    const char *name = items.item[line].name;

    if (!strchr(name, ':'))
        return items.item[line].readers;
    for (unsigned i = 0; i < count; i++)
        if (!strcmp(all[i].name, name))
            return all[i].readers;
    return 0;
}

static void print_machines(void) {
    printf("this machine is %s for others", machines.name);
    printf(machines.same ? ", since %u more have the host name %s\n" : "\n", (unsigned)machines.same, machines.host);
    if (machines.refused)
        printf("%llu records of items and machines were refused: they are invalid, or there are too many\n",
               (unsigned long long)machines.refused);
    printf("%-32s %6s %6s  %s\n", "MACHINE", "STATE", "ITEMS", "CLOCK");
    for (uint32_t i = 0; i < machines.count; i++) {
        char clock[64] = "-";

        if (machines.machine[i].bound >= 0)
            snprintf(clock, sizeof clock, "%+.6f s, to %.6f s", (double)machines.machine[i].offset / 1e9,
                     (double)machines.machine[i].bound / 1e9);
        printf("%-32.40s %6s %6u  %s\n", machines.machine[i].name, machines.machine[i].heard ? "heard" : "away",
               (unsigned)machines.machine[i].items, clock);
    }
}

static void print_items(const struct ddx_item_info *all, unsigned count) {
    printf("%-40s %-20s %6s %7s\n", "ITEM", "TYPE", "STATE", "READERS");
    for (uint32_t i = 0; i < items.count; i++)
        printf("%-40.104s %-20.64s %6s %7u\n", items.item[i].name, items.item[i].type,
               items.item[i].heard ? "heard" : "away", readers_of(i, all, count));
    if (items.known > items.count)
        printf("and %u more\n", (unsigned)(items.known - items.count));
}

/* The catalog has checked names and types: they have no control characters. */
static void print_text(const char *name, const char *text) {
    printf("\"%s\":\"", name);
    for (; *text; text++)
        printf(*text == '"' || *text == '\\' ? "\\%c" : "%c", *text);
    putchar('"');
}

static void print_json(const struct ddx_item_info *all, unsigned count) {
    putchar('{');
    print_text("name", machines.name);
    putchar(',');
    print_text("host", machines.host);
    printf(",\"same\":%u,\"refused\":%llu,\"machines\":[", (unsigned)machines.same,
           (unsigned long long)machines.refused);
    for (uint32_t i = 0; i < machines.count; i++) {
        fputs(i ? ",{" : "{", stdout);
        print_text("name", machines.machine[i].name);
        putchar(',');
        print_text("host", machines.machine[i].host);
        printf(",\"heard\":%s,\"items\":%u,\"offset_ns\":%lld,\"bound_ns\":%lld}",
               machines.machine[i].heard ? "true" : "false", (unsigned)machines.machine[i].items,
               (long long)machines.machine[i].offset, (long long)machines.machine[i].bound);
    }
    fputs("],\"items\":[", stdout);
    for (uint32_t i = 0; i < items.count; i++) {
        fputs(i ? ",{" : "{", stdout);
        print_text("name", items.item[i].name);
        putchar(',');
        print_text("type", items.item[i].type);
        printf(",\"heard\":%s,\"readers\":%u}", items.item[i].heard ? "true" : "false", readers_of(i, all, count));
    }
    printf("],\"more\":%u}\n", (unsigned)(items.known - items.count));
}

/* Read the newest value. */
static int read_value(DDX_STORE_ID *id, const char *name, const char *type, void *value, size_t size) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    int error = item ? strcmp(ddx_store_item_type(item), type) ? -EPROTOTYPE : 0 : -errno;

    if (!error && size)
        error = ddx_store_read(item, value, NULL, 0, DDX_CURRENT);
    ddx_store_done_item(item);
    return error;
}

static int show(DDX_STORE_ID *id, bool json) {
    struct ddx_item_info *all;
    unsigned count;
    int error = read_value(id, TABLE_MACHINES, "CATALOG_MACHINES", &machines, sizeof machines);

    if (!error && *machines.name)
        error = read_value(id, TABLE_ITEMS, "CATALOG_ITEMS", &items, sizeof items);
    if (error == -ENOENT || error == -ETIMEDOUT || (!error && !*machines.name))
        return failed("no catalog runs here, or it waits for the network");
    if (!error)
        error = ddx_store_list(id, NULL, &all, &count);
    if (error)
        return failed(ddx_error_text(error));
    if (machines.count > sizeof machines.machine / sizeof *machines.machine || items.count > TABLE_ITEMS_MAX)
        return failed("the items of the catalog are invalid");
    if (json) {
        print_json(all, count);
    } else {
        print_machines();
        print_items(all, count);
    }
    free(all);
    return fflush(stdout) || ferror(stdout) ? failed(strerror(errno)) : 0;
}

int main(int argc, char **argv) {
    bool json = argc == 2 && (!strcmp(argv[1], "--json") || !strcmp(argv[1], "-json"));

    if (argc == 2 && (!strcmp(argv[1], "-help") || !strcmp(argv[1], "--help"))) {
        fputs(usage, stdout);
        return 0;
    }
    if (argc > 1 && !json) {
        failed("takes --json only");
        return 2;
    }
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, STORE_WAIT);
    if (!id)
        return failed(ddx_error_text(-errno));
    int status = show(id, json);
    ddx_store_close(id);
    return status;
}
