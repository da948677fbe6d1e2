/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Between store and disk: messages in order, in memory that was taken at the start. One thread puts them in and never
 * waits; another takes them out.
 */
#ifndef DDXLOG_QUEUE_H
#define DDXLOG_QUEUE_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct item;
struct channel;

struct queue_entry {
    size_t room;             /* bytes in the queue, with what follows; private */
    struct item *item;       /* private: NULL where the memory ends and the queue goes on at its begin */
    struct channel *channel; /* the layout */
    uint64_t sequence;
    int64_t time, logged, seen; /* of the write; that it is logged at; when we had it. CLOCK_MONOTONIC */
    size_t size;
    unsigned char data[];
};

struct queue {
    unsigned char *memory;
    size_t size;
    uint64_t put, taken, fresh; /* bytes so far; `fresh`: put, but not yet to be seen */
    bool closed;
    pthread_mutex_t lock;
    pthread_cond_t changed;
};

/* 0 or -ENOMEM. */
int queue_init(struct queue *queue, size_t size);
void queue_free(struct queue *queue);

/*
 * A place for `size` bytes of data, to be filled and then given to queue_put(). NULL: there is no room. Never waits for
 * the other thread, but for the few instructions in which it looks where things are.
 */
struct queue_entry *queue_place(struct queue *queue, size_t size);
void queue_put(struct queue *queue);

/* Nothing more will be put. */
void queue_close(struct queue *queue);

/*
 * The next entry, which stays until queue_take(). Waits until CLOCK_MONOTONIC shows `deadline`; NULL then, and when the
 * queue is closed and empty: *end tells.
 */
struct queue_entry *queue_next(struct queue *queue, int64_t deadline, bool *end);
void queue_take(struct queue *queue);

#endif
