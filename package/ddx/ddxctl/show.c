/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdio.h>

#include "ddxctl.h"

int command_show(DDX_STORE_ID *id, const struct request *request) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);
    struct ddx_frame frame;

    if (!item)
        return complain(request->item, errno);
    int result = ddx_store_acquire(item, &frame, 0, DDX_CURRENT);
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
