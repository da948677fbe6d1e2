/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_stats.h"
#include "ddxctl.h"

#define SUFFIX ".stats"

static void print_line(const DDX_STATS *stats, const char *instance) {
    uint64_t lost = 0;

    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        lost += stats->lost[i].frames;
    printf("%-24s in %llu, out %llu, waiting %llu, lost %llu", instance, (unsigned long long)stats->in,
           (unsigned long long)stats->out, (unsigned long long)stats->waiting, (unsigned long long)lost);
    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        if (stats->lost[i].frames)
            printf(" (%.*s %llu)", (int)sizeof stats->lost[i].name, stats->lost[i].name,
                   (unsigned long long)stats->lost[i].frames);
    printf(", latency us p50 %llu, p99 %llu, max %llu, starts %u%s\n",
           (unsigned long long)ddx_stats_percentile(stats, 0.5), (unsigned long long)ddx_stats_percentile(stats, 0.99),
           (unsigned long long)stats->latency_max, (unsigned)stats->starts, stats->running ? "" : ", stopped");
}

static int print_one(DDX_STORE_ID *id, const char *name, bool json) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    char instance[DDX_NAME_MAX + 1], line[DDX_STATS_LINE_MAX];
    DDX_STATS stats;

    if (!item)
        return errno == ENOENT ? 0 : complain(name, errno); /* gone since the list was made */
    int result = ddx_store_read(item, &stats, NULL, 0, DDX_CURRENT);
    ddx_store_done_item(item);
    if (result == -ETIMEDOUT)
        return 0; /* its program has only just begun */
    if (result)
        return complain(name, result);
    snprintf(instance, sizeof instance, "%.*s", (int)(strlen(name) - strlen(SUFFIX)), name);
    if (json) {
        ddx_stats_json(&stats, instance, line, sizeof line);
        puts(line);
    } else
        print_line(&stats, instance);
    return 0;
}

int command_stats(DDX_STORE_ID *id, const struct request *request) {
    struct ddx_item_info *items;
    unsigned count;
    int result = ddx_store_list(id, NULL, &items, &count), status = 0;

    if (result)
        return complain(NULL, result);
    for (unsigned i = 0; i < count; i++) {
        size_t length = strlen(items[i].name);

        if (length > strlen(SUFFIX) && !strcmp(items[i].name + length - strlen(SUFFIX), SUFFIX) &&
            !strcmp(items[i].type, "DDX_STATS") && print_one(id, items[i].name, request->json))
            status = 1;
    }
    fflush(stdout);
    free(items);
    return status;
}
