/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "term.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

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
