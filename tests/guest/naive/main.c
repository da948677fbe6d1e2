/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * naive ITEM FILE: a recorder without precautions against slow disks and power cuts: appends each frame's planes to a
 * file, while the store keeps KEEP frames. Stops on TERM and prints the numbers of frames written and missed. Built
 * into one static file with libddx.
 */
#define DDXVIDEO_UNDECLARED /* any video item will do */
#include <ddxvideo.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define KEEP 8

static volatile sig_atomic_t stop;

static void on_term(int signal) {
    (void)signal;
    stop = 1;
}

int main(int argc, char **argv) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5.0);
    DDX_STORE_ITEM *item = NULL;
    uint64_t written = 0, missed = 0;
    int fd = argc == 3 ? open(argv[2], O_WRONLY | O_CREAT | O_TRUNC, 0644) : -1;
    if (!id || fd < 0)
        return 2;
    signal(SIGTERM, on_term);
    while (!item && !stop) {
        item = ddx_store_lookup_item(id, argv[1], NULL, 0);
        if (!item)
            usleep(5000);
    }
    if (stop || ddx_store_keep(item, KEEP))
        return 1;
    for (;;) {
        struct ddx_frame frame;
        struct ddxvideo_picture view;
        int error = ddx_store_acquire(item, &frame, 0.2, DDX_IN_ORDER);
        if (error == -ETIMEDOUT && stop)
            break; /* the source stops before TERM is sent */
        if (error == -ETIMEDOUT)
            continue;
        if (error || ddxvideo_view(item, frame.data, &view))
            return 1;
        size_t luma = (size_t)view.stride[0] * (size_t)view.rows[0], size = luma / 2 * 3;
        unsigned char *picture = malloc(size);
        if (!picture)
            return 1;
        for (size_t i = 0, at = 0; i < 3; at += (size_t)view.stride[i] * (size_t)view.rows[i], i++)
            memcpy(picture + at, view.plane[i], (size_t)view.stride[i] * (size_t)view.rows[i]);
        missed += frame.missed;
        ddx_store_release(item);
        if (write(fd, picture, size) != (ssize_t)size)
            return 1;
        free(picture);
        written++;
    }
    close(fd);
    printf("%" PRIu64 " %" PRIu64 "\n", written, missed);
    ddx_store_close(id);
    return 0;
}
