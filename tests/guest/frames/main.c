/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * frames ITEM SECONDS [KEEP [MS]]: prints "ready", then a line for each frame of a video item: its number, the source's
 * number, the source's losses so far, its time in ns, when it was published, fields, width, height, the count of missed
 * frames, a checksum. It may lag behind by KEEP frames, or by as many as the store has room for. With MS it is a slow
 * reader, which holds each frame that long. After TERM it stops with the last frame published by then. Built into one
 * static file with libddx, so that it runs in any image.
 */
#define DDXVIDEO_UNDECLARED /* any video item will do */
#include <ddxvideo.h>
#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define PATIENCE 60.0 /* s to wait for the item */
#define KEEP 64

static volatile sig_atomic_t told;

static void on_signal(int number) {
    (void)number;
    told = 1;
}

/* FNV-1a over words of eight bytes, because emulated machines are slow. */
static uint64_t checksum(const struct ddxvideo_picture *view) {
    uint64_t sum = UINT64_C(14695981039346656037);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k + 8 <= view->stride[i] * view->rows[i]; k += 8) {
            uint64_t word;
            memcpy(&word, view->plane[i] + k, 8);
            sum = (sum ^ word) * UINT64_C(1099511628211);
        }
    return sum;
}

int main(int argc, char **argv) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5.0);
    DDX_STORE_ITEM *item = NULL;
    int64_t begin = ddx_time_now();
    unsigned keep = argc > 3 ? (unsigned)atoi(argv[3]) : KEEP;
    useconds_t hold = argc > 4 ? (useconds_t)atoi(argv[4]) * 1000 : 0;
    if (!id || argc < 3 || argc > 5)
        return 2;
    while (!item && ddx_time_now() < begin + (int64_t)(PATIENCE * 1e9)) {
        item = ddx_store_lookup_item(id, argv[1], NULL, 0);
        if (!item)
            usleep(5000);
    }
    if (!item || ddx_store_keep(item, keep))
        return 1;
    setvbuf(stdout, NULL, _IOLBF, 0); /* a test may read the output early, or kill this program */
    signal(SIGTERM, on_signal);
    int64_t stop = 0, end = ddx_time_now() + (int64_t)(atof(argv[2]) * 1e9);
    for (bool ready = false; ddx_time_now() < end; ready = true) {
        struct ddx_frame frame;
        struct ddxvideo_picture view;
        if (told && !stop)
            stop = ddx_time_now();
        int error = ddx_store_acquire(item, &frame, stop ? 0 : 0.1, DDX_IN_ORDER);
        for (; error == -EBUSY && keep > 1; error = ddx_store_acquire(item, &frame, 0.1, DDX_IN_ORDER))
            ddx_store_keep(item, keep /= 2); /* as many as the store has room for */
        if (!ready)
            printf("ready\n"); /* from here on it sees every frame */
        if (stop && (error || frame.time > stop))
            break;
        if (error)
            continue;
        if (!ddxvideo_view_any(item, frame.data, &view))
            printf("%d %" PRId64 " %" PRId64 " %" PRId64 " %" PRId64 " %d %d %d %" PRIu64 " %#018" PRIx64 "\n",
                   view.stamp.frame, view.stamp.source_sequence, view.stamp.source_lost, view.stamp.time, frame.time,
                   view.geometry.fields, view.geometry.width, view.geometry.height, frame.missed, checksum(&view));
        usleep(hold);
        ddx_store_release(item);
    }
    ddx_store_close(id);
    return 0;
}
