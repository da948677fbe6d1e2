/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <signal.h>
#include <stdio.h>

#include "ddxctl.h"

#define WAIT 0.2 /* s between checks for a request to stop */

static volatile sig_atomic_t stop;

static void on_signal(int number) {
    (void)number;
    stop = 1;
}

static void print_write(const DDX_STORE_ITEM *item, const struct ddx_frame *frame, bool json) {
    long long late = (long long)(ddx_time_now() - frame->time) / 1000;

    if (json) {
        printf("{\"name\":");
        json_string(ddx_store_item_name(item), DDX_NAME_MAX);
        printf(",\"sequence\":%llu,\"time_ns\":%lld,\"missed\":%llu,\"wake_us\":%lld}\n",
               (unsigned long long)frame->sequence, (long long)frame->time, (unsigned long long)frame->missed, late);
    } else {
        printf("%s write %llu at %.6f s, missed %llu, seen after %lld us\n", ddx_store_item_name(item),
               (unsigned long long)frame->sequence, (double)frame->time / 1e9, (unsigned long long)frame->missed, late);
    }
    fflush(stdout);
}

int command_watch(DDX_STORE_ID *id, const struct request *request) {
    struct sigaction action = {.sa_handler = on_signal};
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);
    unsigned seen = 0;
    int result = 0;

    if (!item)
        return complain(request->item, errno);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    while (!stop && !ferror(stdout) && (request->count == 0 || seen < request->count)) {
        struct ddx_frame frame;

        result = ddx_store_acquire(item, &frame, WAIT, DDX_NEXT);
        if (result == -ETIMEDOUT) {
            result = 0;
            continue;
        }
        if (result)
            break;
        print_write(item, &frame, request->json);
        ddx_store_release(item);
        seen++;
    }
    ddx_store_done_item(item);
    return result ? complain(request->item, result) : 0;
}
