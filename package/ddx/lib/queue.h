/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Messages that wait until the other side has made room in the socket: an item may have more frames than a socket holds
 * messages, and nobody waits for who is slow. Who has one sends everything through it, and goes on when poll() says
 * POLLOUT, which is to be asked for as long as `count` is not 0.
 */
#ifndef DDX_QUEUE_H
#define DDX_QUEUE_H

#include "wire.h"

struct ddx_queue {
    struct ddx_queued *first, *last;
    unsigned count, files; /* messages, and the descriptors that they hold */
};

/*
 * Send, or keep a copy (of the descriptors, too) until there is room. 0; -EPIPE: the other side is gone; -ENOMEM, or
 * what dup() says: could not be kept.
 */
int ddx_queue_send(struct ddx_queue *queue, int socket, const struct ddx_message *message,
                   const struct ddx_layout *layout, const int *fds, unsigned fd_count);

/* There may be room. 0; -EPIPE: the other side is gone. */
int ddx_queue_go_on(struct ddx_queue *queue, int socket);

/* What was to be said of a reader's former epoch means nothing when the next one has begun. */
void ddx_queue_drop_epoch(struct ddx_queue *queue);

void ddx_queue_clear(struct ddx_queue *queue);

#endif
