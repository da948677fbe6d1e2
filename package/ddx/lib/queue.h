/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Messages wait here until the peer's socket has room (an item may have more frames than a socket holds messages), so
 * no program blocks on a slow peer. Once a queue exists, everything is sent through it. Continue when poll() reports
 * the events of ddx_queue_events(), or after DDX_QUEUE_PAUSE while the queue is crowded.
 */
#ifndef DDX_QUEUE_H
#define DDX_QUEUE_H

#include <stdbool.h>

#include "wire.h"

struct ddx_queue {
    struct ddx_queued *first, *last;
    uint64_t number;       /* of the last message that was put in */
    unsigned count, files; /* messages, and the descriptors that they hold */
    /* Descriptors that others have not read yet are as many as a user may have under way; or the next epoch waits until
     * the other side, which seems to be stopped, has read all: else it would keep, unread, the files of each that
     * begins. poll() does not tell when that is over: it calls the socket writable all the time. */
    bool crowded;
    int64_t since; /* when something was sent and nothing was unread, ns */
};

#define DDX_QUEUE_PAUSE 5 /* ms */

/* Where messages are kept, and what becomes of their descriptors: copies, unless the program says otherwise. */
struct ddx_queue_memory {
    void *(*allocate)(size_t bytes); /* all zeros, or NULL */
    void (*free)(void *memory);
    int (*keep)(int fd); /* a descriptor that is good until let_go(), or -errno */
    void (*let_go)(int fd);
};
extern const struct ddx_queue_memory *ddx_queue_memory;

/* What to ask poll() for, besides POLLIN. */
short ddx_queue_events(const struct ddx_queue *queue);

/* Keep it, to be sent later; it gets the next number. 0; -ENOMEM, or what dup() says: could not be kept. */
int ddx_queue_put(struct ddx_queue *queue, const struct ddx_message *message, const struct ddx_layout *layout,
                  const int *fds, unsigned fd_count);

/* The same, and sends as much as the socket takes. Also -EPIPE: the other side is gone. */
int ddx_queue_send(struct ddx_queue *queue, int socket, const struct ddx_message *message,
                   const struct ddx_layout *layout, const int *fds, unsigned fd_count);

/* Sends what the socket takes now, each message also to `sent` (or NULL). 0; -EPIPE: the other side is gone. */
int ddx_queue_go_on(struct ddx_queue *queue, int socket,
                    void (*sent)(const struct ddx_message *message, void *context), void *context);

/* What was to be said of a reader's former epoch means nothing when the next one has begun. */
void ddx_queue_drop_epoch(struct ddx_queue *queue);

void ddx_queue_clear(struct ddx_queue *queue);

#endif
