/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "flusher.h"

#include <errno.h>
#include <time.h>

#include "ddx_time.h"
#include "program.h"

/* Not before the next file is on the disk: otherwise nothing there would show that the recording continues. */
static bool may_finish(const struct flusher *flusher, const struct segment *segment) {
    const struct segment *next = segment->next;

    return segment->closed && (!next || next->closed || segment_is_promised(next) || *flusher->error);
}

/* Waits for work or for the next flush. False if there will be no more work. */
static bool wait_for_work(struct flusher *flusher, int64_t until) {
    struct timespec deadline = {.tv_sec = (time_t)(until / SECOND), .tv_nsec = (long)(until % SECOND)};
    bool timeout = false;

    pthread_mutex_lock(&flusher->lock);
    while (!timeout && !(flusher->oldest && may_finish(flusher, flusher->oldest)) &&
           !(flusher->stop && !flusher->oldest))
        timeout = pthread_cond_timedwait(&flusher->changed, &flusher->lock, &deadline) == ETIMEDOUT;
    bool more = flusher->oldest || !flusher->stop;
    pthread_mutex_unlock(&flusher->lock);
    return more;
}

static void fail(struct flusher *flusher, int error) {
    int none = 0;

    atomic_compare_exchange_strong(flusher->error, &none, error);
}

static struct segment *younger(struct flusher *flusher, const struct segment *segment) {
    pthread_mutex_lock(&flusher->lock);
    struct segment *next = segment ? segment->next : flusher->oldest;
    pthread_mutex_unlock(&flusher->lock);
    return next;
}

/* Finishes the first segment, if it may be finished, and takes it out of the list. */
static bool finish_oldest(struct flusher *flusher) {
    pthread_mutex_lock(&flusher->lock);
    struct segment *segment = flusher->oldest;
    bool done = segment && may_finish(flusher, segment);
    if (done)
        flusher->oldest = segment->next;
    pthread_mutex_unlock(&flusher->lock);
    int error = done ? segment_finish(segment, *flusher->error) : 0;
    if (error)
        fail(flusher, error);
    return done;
}

/* Older segments first: a power cut at any time leaves no gap in the recording. */
static void flush_all(struct flusher *flusher) {
    int error = 0;

    for (struct segment *segment = younger(flusher, NULL); segment && !error && !*flusher->error;
         segment = younger(flusher, segment))
        error = segment_flush(segment);
    if (error)
        fail(flusher, error);
}

static void *flush(void *argument) {
    struct flusher *flusher = argument;

    program_thread_signals();
    int64_t next = ddx_time_now() + flusher->period;
    while (wait_for_work(flusher, next)) {
        if (ddx_time_now() >= next) {
            next = ddx_time_now() + flusher->period;
            flush_all(flusher);
        }
        while (finish_oldest(flusher))
            ;
    }
    return NULL;
}

int flusher_start(struct flusher *flusher, int64_t period, atomic_int *error) {
    *flusher = (struct flusher){.period = period, .error = error};
    pthread_mutex_init(&flusher->lock, NULL);
    program_condition(&flusher->changed);
    return -pthread_create(&flusher->thread, NULL, flush, flusher);
}

void flusher_add(struct flusher *flusher, struct segment *segment) {
    segment->unsafe = &flusher->unsafe;
    pthread_mutex_lock(&flusher->lock);
    struct segment **end = &flusher->oldest;
    while (*end)
        end = &(*end)->next;
    *end = segment;
    pthread_cond_signal(&flusher->changed);
    pthread_mutex_unlock(&flusher->lock);
}

void flusher_close_segment(struct flusher *flusher, struct segment *segment) {
    pthread_mutex_lock(&flusher->lock);
    segment->closed = true;
    pthread_cond_signal(&flusher->changed);
    pthread_mutex_unlock(&flusher->lock);
}

void flusher_stop(struct flusher *flusher) {
    pthread_mutex_lock(&flusher->lock);
    flusher->stop = true;
    pthread_cond_signal(&flusher->changed);
    pthread_mutex_unlock(&flusher->lock);
    pthread_join(flusher->thread, NULL);
    pthread_cond_destroy(&flusher->changed);
    pthread_mutex_destroy(&flusher->lock);
}
