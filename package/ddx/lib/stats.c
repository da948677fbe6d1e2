/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Counters of frames, and their item in the store. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "stats_book.h"

/* 32-bit and 64-bit programs share this item. */
_Static_assert(offsetof(DDX_STATS, in) == 16, "layout");
_Static_assert(offsetof(DDX_STATS, first) == 56, "layout");
_Static_assert(offsetof(DDX_STATS, source) == 80, "layout");
_Static_assert(offsetof(DDX_STATS, lost) == 144, "layout");
_Static_assert(offsetof(DDX_STATS, latency) == 392, "layout");
_Static_assert(sizeof(DDX_STATS) == 392 + 4 * DDX_STATS_BUCKETS && sizeof(DDX_STATS) % 8 == 0, "layout");

static const char restart_reason[] = "restart";

DDX_STATS_BOOK *ddx_stats_open(const char *instance, const char *const *reasons) {
    size_t count = 0;

    while (reasons[count]) {
        if (!*reasons[count] || strlen(reasons[count]) > DDX_STATS_REASON_MAX || count == DDX_STATS_REASONS - 1) {
            errno = EINVAL;
            return NULL;
        }
        count++;
    }
    if (!*instance || strlen(instance) + strlen(DDX_STATS_SUFFIX) > DDX_NAME_MAX) {
        errno = EINVAL;
        return NULL;
    }
    DDX_STATS_BOOK *book = calloc(1, sizeof *book);
    if (!book)
        return NULL;
    pthread_mutex_init(&book->lock, NULL);
    strcpy(book->instance, instance);
    for (size_t i = 0; i < count; i++)
        strcpy(book->stats.lost[i].name, reasons[i]);
    strcpy(book->stats.lost[count].name, restart_reason);
    book->restart = (unsigned)count;
    book->stats.reasons = (uint32_t)count + 1;
    book->stats.version = DDX_STATS_VERSION;
    book->stats.running = 1;
    book->stats.starts = 1;
    return book;
}

void ddx_stats_latency_until(DDX_STATS_BOOK *book, uint32_t until) {
    pthread_mutex_lock(&book->lock);
    book->stats.latency_until = until;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_in(DDX_STATS_BOOK *book, uint64_t frames, uint64_t sequence) {
    pthread_mutex_lock(&book->lock);
    book->stats.in += frames;
    if (sequence)
        book->stats.sequence = sequence;
    pthread_mutex_unlock(&book->lock);
}

static void count_out(DDX_STATS_BOOK *book, uint64_t frames, int64_t latency, uint64_t sequence) {
    int64_t now = ddx_time_now();

    pthread_mutex_lock(&book->lock);
    book->stats.out += frames;
    if (sequence)
        book->stats.out_sequence = sequence;
    book->stats.publishing = 0;
    if (!book->stats.first)
        book->stats.first = now;
    book->stats.last = now;
    ddx_stats_histogram_add(&book->stats, frames, latency);
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_out(DDX_STATS_BOOK *book, uint64_t frames, int64_t latency) {
    count_out(book, frames, latency, 0);
}

void ddx_stats_out_numbered(DDX_STATS_BOOK *book, uint64_t sequence, int64_t latency) {
    count_out(book, 1, latency, sequence);
}

void ddx_stats_lost(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames) {
    pthread_mutex_lock(&book->lock);
    book->stats.lost[reason < book->restart ? reason : book->restart].frames += frames;
    book->stats.publishing = 0;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_take_back(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames) {
    pthread_mutex_lock(&book->lock);
    book->stats.out -= frames < book->stats.out ? frames : book->stats.out;
    book->stats.lost[reason < book->restart ? reason : book->restart].frames += frames;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_file(DDX_STATS_BOOK *book, uint64_t device, uint64_t inode) {
    pthread_mutex_lock(&book->lock);
    book->stats.file_device = device;
    book->stats.file_inode = inode;
    book->stats.file_out = book->stats.out;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_skipped(DDX_STATS_BOOK *book, uint64_t frames) {
    pthread_mutex_lock(&book->lock);
    book->stats.skipped += frames;
    pthread_mutex_unlock(&book->lock);
}

static void compute_waiting(DDX_STATS *stats) {
    uint64_t accounted = stats->out;

    for (unsigned i = 0; i < stats->reasons; i++)
        accounted += stats->lost[i].frames;
    stats->waiting = stats->in > accounted ? stats->in - accounted : 0;
}

int ddx_stats_write(DDX_STATS_BOOK *book) {
    int error = 0;

    pthread_mutex_lock(&book->lock);
    compute_waiting(&book->stats);
    if (book->item)
        error = ddx_store_write(book->item, &book->stats, NULL);
    pthread_mutex_unlock(&book->lock);
    return error;
}

int ddx_stats_publishing(DDX_STATS_BOOK *book, uint64_t number) {
    pthread_mutex_lock(&book->lock);
    book->stats.publishing = number;
    pthread_mutex_unlock(&book->lock);
    return ddx_stats_write(book);
}

void ddx_stats_get(DDX_STATS_BOOK *book, DDX_STATS *stats) {
    pthread_mutex_lock(&book->lock);
    compute_waiting(&book->stats);
    *stats = book->stats;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_print(DDX_STATS_BOOK *book, FILE *file) {
    DDX_STATS stats;
    char line[DDX_STATS_LINE_MAX];

    ddx_stats_get(book, &stats);
    ddx_stats_json(&stats, book->instance, line, sizeof line);
    fprintf(file, "%s\n", line);
    fflush(file);
}

void ddx_stats_fail(DDX_STATS_BOOK *book) {
    pthread_mutex_lock(&book->lock);
    book->failed = true;
    pthread_mutex_unlock(&book->lock);
}

void ddx_stats_close(DDX_STATS_BOOK *book) {
    if (!book)
        return;
    book->stats.running = 0;
    if (!book->failed)
        book->stats.follows = 0;
    ddx_stats_write(book);
    ddx_store_done_item(book->item);
    pthread_mutex_destroy(&book->lock);
    free(book);
}
