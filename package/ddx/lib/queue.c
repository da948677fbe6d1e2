/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "queue.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/sockios.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "fault.h"
#include "futex.h"

#define PATIENCE 100000000 /* ns */

struct ddx_queued {
    struct ddx_queued *next;
    struct ddx_message message;
    struct ddx_layout *layout; /* or NULL */
    int fd[DDX_FDS_MAX];
    unsigned fd_count;
};

static void forget(struct ddx_queued *queued) {
    for (unsigned i = 0; i < queued->fd_count; i++)
        close(queued->fd[i]);
    free(queued->layout);
    free(queued);
}

static int keep(struct ddx_queue *queue, const struct ddx_message *message, const struct ddx_layout *layout,
                const int *fds, unsigned fd_count) {
    struct ddx_queued *queued = calloc(1, sizeof *queued);

    if (!queued || (layout && !(queued->layout = ddx_layout_copy(layout)))) {
        free(queued);
        return -ENOMEM;
    }
    queued->message = *message;
    for (unsigned i = 0; i < fd_count; i++) {
        queued->fd[i] = fcntl(fds[i], F_DUPFD_CLOEXEC, 0);
        if (queued->fd[i] < 0) {
            int error = errno;

            forget(queued);
            return -error;
        }
        queued->fd_count++;
    }
    if (queue->last)
        queue->last->next = queued;
    else
        queue->first = queued;
    queue->last = queued;
    queue->count++;
    queue->files += fd_count;
    return 0;
}

/* Has it read nothing of an epoch's news for so long that it may be stopped? */
static bool sleeps(struct ddx_queue *queue, int socket) {
    int unread;

    if (DDX_BROKEN("pile") || ioctl(socket, SIOCOUTQ, &unread))
        return false;
    int64_t now = ddx_time_now();
    if (!unread)
        queue->since = now;
    return unread && now > queue->since + PATIENCE;
}

static int try(struct ddx_queue *queue, int socket, const struct ddx_message *message, const struct ddx_layout *layout,
               const int *fds, unsigned fd_count) {
    queue->crowded = message->operation == DDX_EPOCH && sleeps(queue, socket);
    int result = queue->crowded ? -EAGAIN : ddx_send(socket, message, layout, fds, fd_count);
    queue->crowded |= result == -ETOOMANYREFS;
    return queue->crowded ? -EAGAIN : result;
}

short ddx_queue_events(const struct ddx_queue *queue) {
    return queue->count && !queue->crowded ? POLLOUT : 0;
}

int ddx_queue_send(struct ddx_queue *queue, int socket, const struct ddx_message *message,
                   const struct ddx_layout *layout, const int *fds, unsigned fd_count) {
    int result = queue->count ? -EAGAIN : try(queue, socket, message, layout, fds, fd_count);

    return result == -EAGAIN ? keep(queue, message, layout, fds, fd_count) : result;
}

int ddx_queue_go_on(struct ddx_queue *queue, int socket) {
    while (queue->first) {
        struct ddx_queued *queued = queue->first;
        int result = try(queue, socket, &queued->message, queued->layout, queued->fd, queued->fd_count);

        if (result)
            return result == -EAGAIN ? 0 : result;
        queue->first = queued->next;
        if (!queue->first)
            queue->last = NULL;
        queue->count--;
        queue->files -= queued->fd_count;
        forget(queued);
    }
    return 0;
}

static bool of_epoch(const struct ddx_message *message) {
    return message->operation == DDX_EPOCH || (message->operation == DDX_SLOT && message->flags == DDX_FLAG_READER);
}

void ddx_queue_drop_epoch(struct ddx_queue *queue) {
    struct ddx_queued **link = &queue->first;

    queue->last = NULL;
    while (*link) {
        struct ddx_queued *queued = *link;

        if (of_epoch(&queued->message)) {
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
