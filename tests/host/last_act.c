/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: the program is killed at its $LAST_CALL-th frame, right before ddx_store_publish() or right after it, as
 * $LAST_ACT says.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void act(const char *moment, const void *item) {
    static const char *(*name)(const void *item);
    static int calls;
    const char *wanted = getenv("LAST_ACT"), *call = getenv("LAST_CALL");

    if (!name)
        *(void **)&name = dlsym(RTLD_NEXT, "ddx_store_item_name");
    if (!wanted || !call || strcmp(wanted, moment) != 0 || strcmp(name(item), "video") != 0)
        return;
    if (++calls == atoi(call))
        kill(getpid(), SIGKILL);
}

int ddx_store_publish(void *item, const int64_t *time) {
    static int (*publish)(void *item, const int64_t *time);

    if (!publish)
        *(void **)&publish = dlsym(RTLD_NEXT, "ddx_store_publish");
    act("before", item);
    int result = publish(item, time);
    act("after", item);
    return result;
}
