/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "connection.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

int ddx_connection_waker = -1;

void ddx_message_init(struct ddx_message *message, uint32_t operation, const DDX_STORE_ITEM *item) {
    memset(message, 0, sizeof *message);
    message->operation = operation;
    message->pid = (int32_t)getpid();
    strcpy(message->name, item->name);
    strcpy(message->type, item->type);
}

void ddx_connection_wake_keeper(void) {
    uint64_t one = 1;

    if (write(ddx_connection_waker, &one, sizeof one) < 0) {
        /* the counter is full, so the keeper wakes anyway */
    }
}

int ddx_connection_open(DDX_STORE_ITEM *item) {
    int fd = ddx_connect(item->id->port);

    if (fd < 0)
        return fd == -EPERM ? -ECONNREFUSED : fd; /* the true store may come back */
    item->socket = fd;
    item->deaf = false;
    item->heard = 0;
    return 0;
}

int ddx_connection_say(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned fd_count) {
    int result = ddx_queue_send(&item->queue, item->socket, message, layout, fds, fd_count);

    if (item->queue.count)
        ddx_connection_wake_keeper();
    return result;
}
