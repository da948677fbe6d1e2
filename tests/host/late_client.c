/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * late_client FRAMES KEEP: reads FRAMES frames of "video" in order, with KEEP frames kept by the store; prints as JSON
 * the numbers of frames read and missed, and the longest times from write to read and between two writes (us).
 */
#include <ddx.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int main(int argc, char **argv) {
    unsigned long frames = argc > 2 ? strtoul(argv[1], NULL, 10) : 0, got = 0;
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 10);
    DDX_STORE_ITEM *item = id ? ddx_store_await_item(id, "video") : NULL;
    struct ddx_frame frame;
    DDX_TIME late = 0, apart = 0, before = 0;
    int result = item ? ddx_store_keep(item, (unsigned)(argc > 2 ? atoi(argv[2]) : 1)) : -errno;

    while (!result && got < frames && (result = ddx_store_acquire(item, &frame, 30, DDX_IN_ORDER)) == 0) {
        DDX_TIME now = ddx_time_now();

        late = now - frame.time > late ? now - frame.time : late;
        apart = before && frame.time - before > apart ? frame.time - before : apart;
        before = frame.time;
        got++;
        ddx_store_release(item);
    }
    if (result)
        fprintf(stderr, "late_client: %s\n", ddx_error_text(result));
    printf("{\"frames\":%lu,\"missed\":%llu,\"late_us\":%lld,\"apart_us\":%lld}\n", got,
           item ? (unsigned long long)ddx_store_missed(item) : 0, (long long)late / 1000, (long long)apart / 1000);
    ddx_store_close(id);
    return result != 0;
}
