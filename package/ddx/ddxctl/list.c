/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddxctl.h"

static void print_table(const struct ddx_store_info *store, const struct ddx_item_info *items, unsigned count) {
    char size[16], bytes[16], reserved[16];

    printf("%-24s %-14s %7s %7s %8s %6s %7s %7s %10s %8s\n", "ITEM", "TYPE", "SIZE", "MEMORY", "RESERVED", "FRAMES",
           "READERS", "WRITER", "WRITES", "AGE");
    for (unsigned i = 0; i < count; i++) {
        const struct ddx_item_info *item = &items[i];
        char writer[16] = "-", age[16] = "-";

        if (item->writer_pid)
            snprintf(writer, sizeof writer, "%d", (int)item->writer_pid);
        if (item->sequence)
            snprintf(age, sizeof age, "%.2fs", (double)(ddx_time_now() - item->time) / 1e9);
        printf("%-24s %-14s %7s %7s %8s %6u %7u %7s %10llu %8s\n", item->name, item->type,
               readable_bytes(item->size, size), readable_bytes(item->bytes, bytes),
               readable_bytes(item->reserved, reserved), (unsigned)item->frames, (unsigned)item->readers, writer,
               (unsigned long long)item->sequence, age);
    }
    printf("%u items, %s used, %s reserved of %s\n", count, readable_bytes(store->bytes, bytes),
           readable_bytes(store->reserved, reserved), readable_bytes(store->budget, size));
    if (store->restarts)
        printf("its worker died or hung %u times, and was replaced\n", (unsigned)store->restarts);
}

static void print_json(const struct ddx_store_info *store, const struct ddx_item_info *items, unsigned count) {
    printf("{\"budget\":%llu,\"bytes\":%llu,\"reserved\":%llu,\"clients\":%u,\"pid\":%d,\"restarts\":%u,"
           "\"items\":[",
           (unsigned long long)store->budget, (unsigned long long)store->bytes, (unsigned long long)store->reserved,
           (unsigned)store->clients, (int)store->pid, (unsigned)store->restarts);
    for (unsigned i = 0; i < count; i++) {
        const struct ddx_item_info *item = &items[i];

        printf("%s{\"name\":", i ? "," : "");
        json_string(item->name, sizeof item->name);
        printf(",\"type\":");
        json_string(item->type, sizeof item->type);
        printf(",\"size\":%llu,\"frame_bytes\":%llu,\"bytes\":%llu,\"reserved\":%llu,\"frames\":%u,\"readers\":%u,"
               "\"writer_pid\":%d,\"epoch\":%u,\"sequence\":%llu,\"time_ns\":%lld,\"missed_max\":%llu}",
               (unsigned long long)item->size, (unsigned long long)item->frame_bytes, (unsigned long long)item->bytes,
               (unsigned long long)item->reserved, (unsigned)item->frames, (unsigned)item->readers,
               (int)item->writer_pid, (unsigned)item->epoch, (unsigned long long)item->sequence, (long long)item->time,
               (unsigned long long)item->missed_max);
    }
    printf("]}\n");
}

int command_list(DDX_STORE_ID *id, const struct request *request) {
    struct ddx_store_info store;
    struct ddx_item_info *items;
    unsigned count;
    int result = ddx_store_list(id, &store, &items, &count);

    if (result)
        return complain(NULL, result);
    if (request->json)
        print_json(&store, items, count);
    else
        print_table(&store, items, count);
    free(items);
    return 0;
}
