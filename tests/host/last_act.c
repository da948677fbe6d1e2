/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: kills the program with $LAST_SIGNAL at its $LAST_CALL-th frame. $LAST_ACT: `before` or `after`
 * ddx_store_publish(), or `written`: the frame is on disk or sent, but not yet counted as out.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void act(const char *moment) {
    static int calls;
    const char *wanted = getenv("LAST_ACT"), *call = getenv("LAST_CALL"), *number = getenv("LAST_SIGNAL");

    if (wanted && call && !strcmp(wanted, moment) && ++calls == atoi(call))
        kill(getpid(), number ? atoi(number) : SIGKILL);
}

void ddx_stats_out_numbered(void *book, uint64_t sequence, int64_t latency) {
    static void (*out)(void *book, uint64_t sequence, int64_t latency);

    if (!out)
        *(void **)&out = dlsym(RTLD_NEXT, "ddx_stats_out_numbered");
    act("written");
    out(book, sequence, latency);
}

void ddx_stats_out(void *book, uint64_t frames, int64_t latency) {
    static void (*out)(void *book, uint64_t frames, int64_t latency);

    if (!out)
        *(void **)&out = dlsym(RTLD_NEXT, "ddx_stats_out");
    act("written");
    out(book, frames, latency);
}

int ddx_store_publish(void *item, const int64_t *time) {
    static int (*publish)(void *item, const int64_t *time);
    static const char *(*name)(const void *item);

    if (!publish) {
        *(void **)&publish = dlsym(RTLD_NEXT, "ddx_store_publish");
        *(void **)&name = dlsym(RTLD_NEXT, "ddx_store_item_name");
    }
    if (strcmp(name(item), "video") != 0)
        return publish(item, time);
    act("before");
    int result = publish(item, time);
    act("after");
    return result;
}
