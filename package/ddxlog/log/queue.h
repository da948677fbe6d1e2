/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The queue between store and disk: messages in order, in memory allocated at the start. One thread puts messages in
 * and never waits; another takes them out.
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
    size_t room;             /* bytes in the queue, with data and padding; private */
    struct item *item;       /* NULL (private): skip the rest of the memory and continue at its begin */
    struct channel *channel; /* the layout */
    uint64_t sequence;
    int64_t time, logged; /* time of the write, time to log it with; CLOCK_MONOTONIC */
    size_t size;
    unsigned char data[];
};

struct queue {
    unsigned char *memory;
    size_t size;
    uint64_t put, taken, fresh; /* bytes so far; `fresh`: with the entry that is being filled */
    bool closed;
    pthread_mutex_t lock;
    pthread_cond_t changed;
};

/* 0 or -ENOMEM. */
int queue_init(struct queue *queue, size_t size);
void queue_free(struct queue *queue);

/*
 * Get a place for `size` bytes of data, to be filled before queue_put(). NULL: no room. Never waits for the other
 * thread, except while that thread holds the lock for a few instructions.
 */
struct queue_entry *queue_place(struct queue *queue, size_t size);
void queue_put(struct queue *queue);

/* No further entry will be put. */
void queue_close(struct queue *queue);

/*
 * Get the next entry, which remains until queue_take(). Waits until `deadline` (CLOCK_MONOTONIC). NULL: no entry; *end:
 * the queue is closed and empty.
 */
struct queue_entry *queue_next(struct queue *queue, int64_t deadline, bool *end);
void queue_take(struct queue *queue);

#endif
