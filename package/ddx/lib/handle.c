/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "handle.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

DDX_COLD int ddx_item_copies(const DDX_STORE_ITEM *item) {
    return *item->type && !item->own ? -EPROTOTYPE : 0; /* an awaited item has no type yet */
}

int ddx_item_set_layout(DDX_STORE_ITEM *item, const struct ddx_layout *layout) {
    if (item->layout && layout->field_count == item->layout->field_count &&
        !memcmp(layout, item->layout, ddx_layout_bytes(layout->field_count)))
        return 0;
    struct ddx_layout *copy = ddx_layout_copy(layout);
    if (!copy)
        return -ENOMEM;
    free(item->layout);
    free(item->fields);
    item->layout = copy;
    item->fields = NULL;
    item->layouts++;
    return 0;
}

/* ---- Connection to the store ---- */

/* Never waits: the store may be slow or stopped while frames continue to flow. */

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
    item->lost_files = false;
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

/* ---- Files of an epoch ---- */

/* They are mapped and unmapped here. */

int ddx_term_new(struct ddx_term **result, uint32_t epoch, const struct ddx_layout *layout,
                 const struct ddx_layout *own, int control_fd, bool writable) {
    struct ddx_term *term = calloc(1, sizeof *term);
    int error = -ENOMEM;

    if (!term)
        goto close_control;
    term->epoch = epoch;
    term->writable = writable;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        term->fd[i] = -1;
    term->layout = ddx_layout_copy(layout);
    if (!term->layout)
        goto free_term;
    ddx_runs_of(layout, &term->runs);
    term->mismatch = ddx_layout_match(layout, own ? own : layout, &term->spans, &term->span_count);
    if (term->mismatch)
        term->spans = NULL;
    term->uncopied = own ? term->mismatch : -EPROTOTYPE;
    error = -EPROTO;
    if (control_fd < 0 || !ddx_memory_sound(control_fd, ddx_page_round(sizeof(struct ddx_control)), !writable))
        goto free_layout;
    term->control = ddx_memory_map(control_fd, sizeof(struct ddx_control), writable);
    if (!term->control) {
        error = -errno;
        goto free_layout;
    }
    if (term->control->magic != DDX_CONTROL_MAGIC || term->control->version != DDX_LAYOUT_VERSION)
        goto unmap;
    if (writable && (error = ddx_memory_freeze(control_fd)))
        goto unmap;
    term->control_fd = control_fd;
    *result = term;
    return 0;

unmap:
    munmap(term->control, sizeof(struct ddx_control));
free_layout:
    free(term->spans);
    free(term->layout);
free_term:
    free(term);
close_control:
    if (control_fd >= 0)
        close(control_fd);
    return error;
}

int ddx_term_add_slot(struct ddx_term *term, unsigned slot, int fd) {
    int error = -EPROTO;

    if (slot >= DDX_SLOTS_MAX || term->base[slot] || fd < 0 ||
        !ddx_memory_sound(fd, term->runs.file_bytes, !term->writable))
        goto close_fd;
    void *base = ddx_slot_reserve(term->runs.span_bytes);
    if (!base) {
        error = -errno;
        goto close_fd;
    }
    error = ddx_slot_map(base, &term->runs, fd, term->writable);
    if (!error && term->writable)
        error = ddx_memory_freeze(fd);
    if (error) {
        ddx_slot_unmap(base, term->runs.span_bytes);
        goto close_fd;
    }
    term->fd[slot] = fd;
    term->base[slot] = base;
    return 0;

close_fd:
    if (fd >= 0)
        close(fd);
    return error;
}

void ddx_term_free(struct ddx_term *term) {
    if (!term)
        return;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++) {
        ddx_slot_unmap(term->base[i], term->runs.span_bytes);
        if (term->fd[i] >= 0)
            close(term->fd[i]);
    }
    munmap(term->control, sizeof(struct ddx_control));
    close(term->control_fd);
    free(term->spans);
    free(term->layout);
    free(term);
}
