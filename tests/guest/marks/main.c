/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * marks ITEM DEVICE: writes `mark N ` to the device for each frame of the item as soon as it is in the store; N counts
 * from 0. A log of the disk's writes then has the newest frame at any time. Runs until it is killed. Built into one
 * static file with libddx.
 */
#include <ddx.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define BLOCK 512 /* of O_DIRECT */

int main(int argc, char **argv) {
    static _Alignas(BLOCK) char block[BLOCK];
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5.0);
    DDX_STORE_ITEM *item = NULL;
    int fd = argc == 3 ? open(argv[2], O_WRONLY | O_DIRECT) : -1;

    if (!id || fd < 0)
        return 2;
    while (!(item = ddx_store_lookup_item(id, argv[1], NULL, 0)))
        usleep(5000);
    for (;;) {
        struct ddx_frame frame;
        int error = ddx_store_acquire(item, &frame, 1.0, DDX_NEXT);

        if (error == -ETIMEDOUT)
            continue;
        if (error)
            return 1;
        ddx_store_release(item);
        memset(block, 0, sizeof block);
        snprintf(block, sizeof block, "mark %" PRIu64 " ", frame.sequence - 1);
        if (pwrite(fd, block, sizeof block, 0) != (ssize_t)sizeof block)
            return 1;
    }
}
