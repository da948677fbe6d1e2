/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "queue.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/sockios.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define PATIENCE_NS 100000000

struct ddx_queued {
    struct ddx_queued *next;
    struct ddx_message message;
    struct ddx_layout *layout; /* or NULL */
    int fd[DDX_FDS_MAX];
    unsigned fd_count;
};

static void *allocate(size_t bytes) {
    return calloc(1, bytes);
}

static int keep_copy(int fd) {
    int copy = fcntl(fd, F_DUPFD_CLOEXEC, 0);

    return copy < 0 ? -errno : copy;
}

static void close_copy(int fd) {
    close(fd);
}

static const struct ddx_queue_memory copies = {allocate, free, keep_copy, close_copy};
const struct ddx_queue_memory *ddx_queue_memory = &copies;

static void forget(struct ddx_queued *queued) {
    for (unsigned i = 0; i < queued->fd_count; i++)
        ddx_queue_memory->let_go(queued->fd[i]);
    ddx_queue_memory->free(queued->layout);
    ddx_queue_memory->free(queued);
}

static struct ddx_layout *copy_layout(const struct ddx_layout *layout) {
    size_t bytes = ddx_layout_bytes(layout->field_count);
    struct ddx_layout *copy = ddx_queue_memory->allocate(bytes);

    return copy ? memcpy(copy, layout, bytes) : NULL;
}

int ddx_queue_put(struct ddx_queue *queue, const struct ddx_message *message, const struct ddx_layout *layout,
                  const int *fds, unsigned fd_count) {
    struct ddx_queued *queued = ddx_queue_memory->allocate(sizeof *queued);

    if (!queued || (layout && !(queued->layout = copy_layout(layout)))) {
        ddx_queue_memory->free(queued);
        return -ENOMEM;
    }
    queued->message = *message;
    queued->message.number = queue->number + 1;
    for (unsigned i = 0; i < fd_count; i++) {
        int kept = ddx_queue_memory->keep(fds[i]);

        if (kept < 0) {
            forget(queued);
            return kept;
        }
        queued->fd[queued->fd_count++] = kept;
    }
    if (queue->last)
        queue->last->next = queued;
    else
        queue->first = queued;
    queue->last = queued;
    queue->number++;
    queue->count++;
    queue->files += fd_count;
    return 0;
}

/* Whether the peer has left messages unread for so long that it may be stopped. */
static bool is_asleep(struct ddx_queue *queue, int socket) {
    int unread;

    if (ioctl(socket, SIOCOUTQ, &unread))
        return false;
    int64_t now = ddx_time_now();
    if (!unread)
        queue->since = now;
    return unread && now > queue->since + PATIENCE_NS;
}

static int try(struct ddx_queue *queue, int socket, const struct ddx_message *message, const struct ddx_layout *layout,
               const int *fds, unsigned fd_count) {
    bool sleeping = is_asleep(queue, socket);

    queue->crowded = message->operation == DDX_EPOCH && sleeping;
    int result = queue->crowded ? -EAGAIN : ddx_send(socket, message, layout, fds, fd_count);
    queue->crowded |= result == -ETOOMANYREFS;
    return queue->crowded ? -EAGAIN : result;
}

short ddx_queue_events(const struct ddx_queue *queue) {
    return queue->count && !queue->crowded ? POLLOUT : 0;
}

int ddx_queue_send(struct ddx_queue *queue, int socket, const struct ddx_message *message,
                   const struct ddx_layout *layout, const int *fds, unsigned fd_count) {
    struct ddx_message numbered = *message;

    numbered.number = queue->number + 1;
    int result = queue->count ? -EAGAIN : try(queue, socket, &numbered, layout, fds, fd_count);
    queue->number += !result;
    return result == -EAGAIN ? ddx_queue_put(queue, message, layout, fds, fd_count) : result;
}

int ddx_queue_go_on(struct ddx_queue *queue, int socket, void (*sent)(const struct ddx_message *message, void *context),
                    void *context) {
    while (queue->first) {
        struct ddx_queued *queued = queue->first;
        int result = try(queue, socket, &queued->message, queued->layout, queued->fd, queued->fd_count);

        if (result)
            return result == -EAGAIN ? 0 : result;
        if (sent)
            sent(&queued->message, context);
        queue->first = queued->next;
        if (!queue->first)
            queue->last = NULL;
        queue->count--;
        queue->files -= queued->fd_count;
        forget(queued);
    }
    return 0;
}

static bool is_of_epoch(const struct ddx_message *message) {
    return message->operation == DDX_EPOCH || (message->operation == DDX_SLOT && message->flags == DDX_FLAG_READER);
}

void ddx_queue_drop_epoch(struct ddx_queue *queue) {
    struct ddx_queued **link = &queue->first;

    queue->last = NULL;
    while (*link) {
        struct ddx_queued *queued = *link;

        if (is_of_epoch(&queued->message)) {
            *link = queued->next;
            queue->count--;
            queue->files -= queued->fd_count;
            forget(queued);
            continue;
        }
        queue->last = queued;
        link = &queued->next;
    }
}

void ddx_queue_clear(struct ddx_queue *queue) {
    for (struct ddx_queued *queued = queue->first, *next; queued; queued = next) {
        next = queued->next;
        forget(queued);
    }
    *queue = (struct ddx_queue){0};
}
