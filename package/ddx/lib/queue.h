/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Messages wait here until the peer's socket has room (an item may have more frames than a socket holds messages), so
 * no program blocks on a slow peer. Once a queue exists, everything is sent through it. Continue when poll() reports
 * the events of ddx_queue_events(), or after DDX_QUEUE_PAUSE_MS while the queue is crowded.
 */
#ifndef DDX_QUEUE_H
#define DDX_QUEUE_H

#include <stdbool.h>

#include "wire.h"

struct ddx_queue {
    struct ddx_queued *first, *last;
    uint64_t number;       /* of the last message queued */
    unsigned count, files; /* queued messages, and the descriptors that they hold */
    /* Sending pauses: the user's unread descriptors have reached the kernel's limit, or the next epoch waits until the
     * peer, which seems to be stopped, has read all messages (else its socket would collect the files of every new
     * epoch). poll() does not report the end of this state, since the socket is writable all the time. */
    bool crowded;
    int64_t since; /* last time that something was sent while nothing was unread, ns */
};

#define DDX_QUEUE_PAUSE_MS 5

/* Allocator of queued messages, and how their descriptors are kept: as copies, unless the program replaces this. */
struct ddx_queue_memory {
    void *(*allocate)(size_t bytes); /* all zeros, or NULL */
    void (*free)(void *memory);
    int (*keep)(int fd); /* a descriptor that is valid until let_go(), or -errno */
    void (*let_go)(int fd);
};
extern const struct ddx_queue_memory *ddx_queue_memory;

/* Events to poll() for, besides POLLIN. */
short ddx_queue_events(const struct ddx_queue *queue);

/* Queue the message, with the next number. 0; -ENOMEM, or the error of dup(): not queued. */
int ddx_queue_put(struct ddx_queue *queue, const struct ddx_message *message, const struct ddx_layout *layout,
                  const int *fds, unsigned fd_count);

/* The same, and send as much as the socket takes. Also -EPIPE: the peer has disconnected. */
int ddx_queue_send(struct ddx_queue *queue, int socket, const struct ddx_message *message,
                   const struct ddx_layout *layout, const int *fds, unsigned fd_count);

/* Send as much as the socket takes now; `sent` (or NULL) is called for each message. 0; -EPIPE: peer disconnected. */
int ddx_queue_go_on(struct ddx_queue *queue, int socket, void (*sent)(const struct ddx_message *message, void *context),
                    void *context);

/* Drop queued messages about a reader's former epoch, which are obsolete once the next one has begun. */
void ddx_queue_drop_epoch(struct ddx_queue *queue);

void ddx_queue_clear(struct ddx_queue *queue);

#endif
