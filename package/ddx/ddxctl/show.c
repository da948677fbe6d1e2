/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "ddxctl.h"

#define FIRST_WAIT 1.0 /* s, for the first value after a subscription */

/*
 * Acquire the newest value. The store may hold another machine's value from before this subscription: a newer one than
 * `begin` is waited for, and if none comes, a line has the age of the last one. 0 or -errno.
 */
static int acquire(DDX_STORE_ITEM *item, const char *name, int64_t begin, struct ddx_frame *frame) {
    bool remote = strchr(ddx_store_item_name(item), ':');
    int result = ddx_store_acquire(item, frame, remote ? FIRST_WAIT : 0, DDX_CURRENT);
    double left = FIRST_WAIT - (double)(ddx_time_now() - begin) / 1e9;

    if (result || !remote || frame->time >= begin)
        return result;
    ddx_store_release(item);
    result = ddx_store_acquire(item, frame, left > 0 ? left : 0, DDX_NEXT);
    if (result != -ETIMEDOUT)
        return result;
    result = ddx_store_acquire(item, frame, 0, DDX_CURRENT);
    if (!result)
        fprintf(stderr, "ddxctl: %s: no new value within %.0f s; the last one is %.3f s old\n", name, FIRST_WAIT,
                (double)(ddx_time_now() - frame->time) / 1e9);
    return result;
}

int command_show(DDX_STORE_ID *id, const struct request *request) {
    int64_t begin = ddx_time_now();
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);
    struct ddx_frame frame;

    if (!item)
        return complain(request->item, errno);
    int result = acquire(item, request->item, begin, &frame);
    if (result) {
        ddx_store_done_item(item);
        if (result != -ETIMEDOUT)
            return complain(request->item, result);
        fprintf(stderr, "ddxctl: %s: nothing was written yet\n", request->item);
        return 1;
    }
    double age = (double)(ddx_time_now() - frame.time) / 1e9;
    if (request->json) {
        printf("{\"name\":");
        json_string(request->item, DDX_NAME_MAX);
        printf(",\"type\":");
        json_string(ddx_store_item_type(item), DDX_NAME_MAX);
        printf(",\"sequence\":%llu,\"time_ns\":%lld,", (unsigned long long)frame.sequence, (long long)frame.time);
        print_fields(item, frame.data, true);
        printf("}\n");
    } else {
        printf("%s: %s, write %llu, %.3f s ago\n", request->item, ddx_store_item_type(item),
               (unsigned long long)frame.sequence, age);
        print_fields(item, frame.data, false);
    }
    ddx_store_release(item);
    ddx_store_done_item(item);
    return 0;
}
