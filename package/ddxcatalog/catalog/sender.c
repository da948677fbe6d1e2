/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sender.h"

#include <envelope.h>
#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define KEEP 64           /* values that the store keeps for us */
#define KEEP_BYTES 262144u
#define TURN 0.05         /* s between two looks for a new reader */

struct sender {
    struct catalog *catalog;
    const struct form *form;
    struct network_writer *writer;
    DDX_STORE_ITEM *item;
    uint32_t layout;
    unsigned keep;
    unsigned char *message;
    size_t size;
    int64_t wall; /* of the message; 0: none yet */
    pthread_t thread;
    atomic_bool stopping, repeat, ended;
};

static int64_t wall_offset(void) {
    struct timespec wall;

    clock_gettime(CLOCK_REALTIME, &wall);
    return wall.tv_sec * INT64_C(1000000000) + wall.tv_nsec - ddx_time_now();
}

static int pack(struct sender *sender, const struct ddx_frame *frame) {
    const struct form *form = sender->form;
    const struct envelope envelope = {.machine = sender->catalog->identity.name,
                                      .sequence = frame->sequence,
                                      .wall = frame->time + wall_offset(),
                                      .monotonic = frame->time};

    if (ddx_store_layout(sender->item) != sender->layout)
        return -EPROTOTYPE;
    unsigned char *at = envelope_write(&envelope, sender->message);
    unsigned char kept[FORM_HEADER]; /* where form_pack() puts its header */
    memcpy(kept, at - FORM_HEADER, sizeof kept);
    form_pack(form, frame->data, at - FORM_HEADER);
    memcpy(at - FORM_HEADER, kept, sizeof kept);
    sender->wall = envelope.wall;
    return 0;
}

static void count(struct sender *sender, const struct ddx_frame *frame, int error) {
    DDX_STATS_BOOK *book = sender->catalog->book;

    ddx_stats_in(book, 1 + frame->missed, 0);
    if (frame->missed)
        ddx_stats_lost(book, LOST_STORE, frame->missed);
    if (error)
        ddx_stats_lost(book, error == -EAGAIN ? LOST_BANDWIDTH : LOST_STORE, 1);
    else
        ddx_stats_out(book, 1, ddx_time_now() - frame->time);
}

/* Take a value, send it. 0, or the item cannot be read any more. */
static int turn(struct sender *sender) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(sender->item, &frame, TURN, sender->wall ? DDX_IN_ORDER : DDX_CURRENT);

    if (error == -EBUSY && !sender->wall && sender->keep > 1) { /* other readers have the frames */
        sender->keep /= 2;
        return ddx_store_keep(sender->item, sender->keep);
    }
    if (error)
        return error == -ETIMEDOUT ? 0 : error;
    error = pack(sender, &frame);
    int sent = error ? error : network_write(sender->writer, sender->message, sender->size, sender->wall);
    count(sender, &frame, sent);
    ddx_store_release(sender->item);
    return error;
}

static void *run(void *argument) {
    struct sender *sender = argument;
    int error = 0;

    program_thread_signals();
    while (!error && !sender->stopping) {
        if (atomic_exchange(&sender->repeat, false) && sender->wall)
            network_write(sender->writer, sender->message, sender->size, sender->wall);
        error = turn(sender);
    }
    sender->ended = true;
    return NULL;
}

static unsigned keep_of(const struct form *form) {
    uint64_t keep = KEEP_BYTES / (form->item_size ? form->item_size : 1);

    return keep > KEEP ? KEEP : keep < 2 ? 2 : (unsigned)keep;
}

struct sender *sender_start(struct catalog *catalog, const char *item, const struct form *form,
                            struct network_writer *writer) {
    struct sender *sender = calloc(1, sizeof *sender);

    if (!sender)
        return NULL;
    sender->catalog = catalog;
    sender->form = form;
    sender->writer = writer;
    sender->size = envelope_size(catalog->identity.name) + form->message_size - FORM_HEADER;
    sender->message = malloc(sender->size + 4); /* DDS pads to four bytes */
    sender->item = sender->message ? ddx_store_lookup_item(catalog->id, item, NULL, 0) : NULL;
    int error = sender->item ? 0 : errno;
    if (!error) {
        sender->layout = ddx_store_layout(sender->item);
        sender->keep = keep_of(form);
        ddx_store_keep(sender->item, sender->keep);
        error = pthread_create(&sender->thread, NULL, run, sender);
    }
    if (!error)
        return sender;
    ddx_store_done_item(sender->item);
    free(sender->message);
    free(sender);
    errno = error;
    return NULL;
}

void sender_repeat(struct sender *sender) {
    sender->repeat = true;
}

bool sender_ended(const struct sender *sender) {
    return sender->ended;
}

void sender_stop(struct sender *sender) {
    if (!sender)
        return;
    sender->stopping = true;
    pthread_join(sender->thread, NULL);
    ddx_store_done_item(sender->item);
    free(sender->message);
    free(sender);
}
