/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Counters of frames, and their item in the store. */
#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_stats.h"

#define DDX_STATS_SUFFIX ".stats"

/* The counters of ddx_stats.h. */
struct ddx_stats_book {
    pthread_mutex_t lock;
    char instance[DDX_NAME_MAX + 1];
    DDX_STATS stats;      /* totals, those of former starts included */
    unsigned restart;     /* number of the reason "restart" */
    bool failed;          /* exits without a request to stop */
    DDX_STORE_ITEM *item; /* NULL: not attached */
};

/* ---- Histogram of latencies ---- */

/* Latency histogram with log-linear buckets: fixed memory, bounded relative error (see DDX_STATS_BUCKETS). */

#define PARTS 32 /* per power of two */
#define PARTS_LOG2 5

_Static_assert(DDX_STATS_BUCKETS == PARTS + (27 - PARTS_LOG2) * PARTS, "buckets reach 2^27 us");

static unsigned bucket_of(uint64_t us) {
    if (us < PARTS)
        return (unsigned)us;
    if (us >> 27)
        return DDX_STATS_BUCKETS - 1;
    unsigned octave = 63 - (unsigned)__builtin_clzll(us); /* 5 to 26 */
    unsigned part = (unsigned)(us >> (octave - PARTS_LOG2)) - PARTS;
    return PARTS + (octave - PARTS_LOG2) * PARTS + part;
}

static uint64_t bucket_middle(unsigned bucket) {
    if (bucket < 2 * PARTS)
        return bucket; /* one µs wide */
    unsigned octave = PARTS_LOG2 + (bucket - PARTS) / PARTS;
    uint64_t width = UINT64_C(1) << (octave - PARTS_LOG2);
    return (UINT64_C(1) << octave) + (bucket - PARTS) % PARTS * width + width / 2;
}

static uint32_t saturated(uint64_t count) {
    return count > UINT32_MAX ? UINT32_MAX : (uint32_t)count;
}

static void ddx_stats_histogram_add(DDX_STATS *stats, uint64_t frames, int64_t latency) {
    uint64_t us = latency > 0 ? (uint64_t)latency / 1000 : 0;
    uint32_t *bucket = &stats->latency[bucket_of(us)];

    *bucket = saturated(*bucket + frames);
    if (us > stats->latency_max)
        stats->latency_max = us;
}

static void ddx_stats_histogram_merge(DDX_STATS *stats, const DDX_STATS *former) {
    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++)
        stats->latency[i] = saturated((uint64_t)stats->latency[i] + former->latency[i]);
    if (former->latency_max > stats->latency_max)
        stats->latency_max = former->latency_max;
}

uint64_t ddx_stats_percentile(const DDX_STATS *stats, double share) {
    uint64_t total = 0, below = 0;

    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++)
        total += stats->latency[i];
    double wanted = share * (double)total;
    for (unsigned i = 0; i < DDX_STATS_BUCKETS; i++) {
        below += stats->latency[i];
        if (below && (double)below >= wanted) {
            uint64_t us = i == DDX_STATS_BUCKETS - 1 ? stats->latency_max : bucket_middle(i);

            return us < stats->latency_max ? us : stats->latency_max;
        }
    }
    return 0;
}

/* ---- Counts ---- */

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

/* ---- Former counts ---- */

/* A restarted program continues the totals of the previous one, so that in = out + lost holds across restarts. */

/* The index of the reason of this name; a new one if there is room; else "restart", so that no loss is dropped. */
static unsigned reason_named(struct ddx_stats_book *book, const char *name) {
    DDX_STATS *stats = &book->stats;

    for (unsigned i = 0; i < stats->reasons; i++)
        if (!strncmp(stats->lost[i].name, name, sizeof(stats->lost[i].name)))
            return i;
    if (stats->reasons == DDX_STATS_REASONS || !*name)
        return book->restart;
    memcpy(stats->lost[stats->reasons].name, name, sizeof(stats->lost[0].name));
    return stats->reasons++;
}

/* Continue the totals of `former`, whose contents are not trusted. */
static void ddx_stats_take_over(struct ddx_stats_book *book, const DDX_STATS *former) {
    DDX_STATS *stats = &book->stats;

    if (former->version != DDX_STATS_VERSION)
        return;
    unsigned reasons = former->reasons < DDX_STATS_REASONS ? former->reasons : DDX_STATS_REASONS;
    uint64_t accounted = former->out;
    for (unsigned i = 0; i < reasons; i++) {
        char name[sizeof(former->lost[i].name)];

        memcpy(name, former->lost[i].name, sizeof name);
        name[sizeof name - 1] = 0;
        stats->lost[reason_named(book, name)].frames += former->lost[i].frames;
        accounted += former->lost[i].frames;
    }
    if (former->in > accounted) { /* died with these waiting, one of them perhaps being published */
        stats->publishing = former->publishing;
        uint64_t died = former->in - accounted - (former->publishing ? 1 : 0);
        stats->lost[book->restart].frames += died;
        stats->died = former->died + died;
    } else {
        stats->died = former->died;
    }
    stats->file_device = former->file_device;
    stats->file_inode = former->file_inode;
    stats->file_out = former->file_out;
    stats->out_sequence = former->out_sequence;
    stats->in += former->in;
    stats->out += former->out;
    stats->skipped += former->skipped;
    stats->starts += former->starts;
    if (former->first)
        stats->first = former->first;
    if (!stats->last)
        stats->last = former->last;
    ddx_stats_histogram_merge(stats, former);
    if (*stats->source && !strncmp(stats->source, former->source, sizeof(stats->source))) {
        stats->sequence = former->sequence;
        stats->follows = former->follows;
    }
}

/* Read the former program's value. With a handle of its own, so that the reader's share is released at once. */
static int read_former(DDX_STORE_ID *id, const char *name, DDX_STATS *former) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);

    if (!item)
        return -errno;
    int error = ddx_store_read(item, former, NULL, 0, DDX_CURRENT);
    ddx_store_done_item(item);
    return error;
}

/* -EEXIST if the item's living writer keeps counters there; else the reason why the item cannot hold counters. */
static int refused_by(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, "DDX_STATS", (int)sizeof(DDX_STATS));
    int error = item ? -EEXIST : -errno;

    ddx_store_done_item(item);
    return error;
}

int ddx_stats_attach(DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source) {
    char name[DDX_NAME_MAX + 1];
    size_t length = strlen(book->instance);

    memcpy(name, book->instance, length);
    memcpy(name + length, DDX_STATS_SUFFIX, sizeof(DDX_STATS_SUFFIX));

    /* First the writer's role, then the value: no other program can change it in between. */
    struct ddx_item_spec spec = {.name = name, .type = "DDX_STATS", .size = sizeof(DDX_STATS)};
    DDX_STORE_ITEM *item;
    int error = ddx_store_create(id, &spec, &item);
    if (error)
        return error == -EEXIST ? refused_by(id, name) : error;
    DDX_STATS former;
    int unread = read_former(id, name, &former);

    pthread_mutex_lock(&book->lock);
    if (source && strlen(source) < sizeof(book->stats.source))
        strcpy(book->stats.source, source);
    if (!unread)
        ddx_stats_take_over(book, &former);
    book->item = item;
    pthread_mutex_unlock(&book->lock);
    return ddx_stats_write(book);
}

void ddx_stats_published(DDX_STATS_BOOK *book, uint64_t written) {
    pthread_mutex_lock(&book->lock);
    DDX_STATS *stats = &book->stats;
    if (stats->publishing && stats->publishing <= written)
        stats->out++;
    else if (stats->publishing)
        stats->lost[book->restart].frames++;
    stats->publishing = 0;
    pthread_mutex_unlock(&book->lock);
    ddx_stats_write(book);
}

void ddx_stats_found(DDX_STATS_BOOK *book, uint64_t frames) {
    pthread_mutex_lock(&book->lock);
    DDX_STATS *stats = &book->stats;
    if (frames > stats->died)
        frames = stats->died;
    stats->out += frames;
    stats->lost[book->restart].frames -= frames;
    stats->died = 0;
    stats->file_device = stats->file_inode = 0;
    pthread_mutex_unlock(&book->lock);
    ddx_stats_write(book);
}

uint64_t ddx_stats_follow(DDX_STATS_BOOK *book, uint64_t sequence) {
    return ddx_stats_follow_some(book, sequence, NULL, NULL);
}

uint64_t ddx_stats_follow_some(DDX_STATS_BOOK *book, uint64_t sequence, ddx_stats_wanted *wanted,
                               const void *argument) {
    pthread_mutex_lock(&book->lock);
    DDX_STATS *stats = &book->stats;
    uint64_t from = stats->sequence <= sequence ? stats->sequence : 0;
    uint64_t all = stats->follows ? sequence - from : 0;
    uint64_t gap = wanted && all ? wanted(argument, sequence) - wanted(argument, from) : all;
    stats->skipped += all - gap;
    stats->in += gap;
    stats->lost[book->restart].frames += gap;
    stats->sequence = sequence;
    stats->follows = 1;
    pthread_mutex_unlock(&book->lock);
    ddx_stats_write(book);
    return gap;
}

/* ---- JSON ---- */

/* The JSON line of a DDX_STATS. */

struct line {
    char *text;
    size_t size, length; /* length includes text that did not fit */
};

__attribute__((format(printf, 2, 3))) static void put(struct line *line, const char *format, ...) {
    size_t room = line->length < line->size ? line->size - line->length : 0;

    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(room ? line->text + line->length : NULL, room, format, arguments);
    va_end(arguments);
    line->length += length > 0 ? (size_t)length : 0;
}

/* At most `limit` bytes of text, escaped: text from a store item may contain any bytes. */
static void put_string(struct line *line, const char *text, size_t limit) {
    put(line, "\"");
    for (size_t i = 0; i < limit && text[i]; i++) {
        unsigned char c = (unsigned char)text[i];

        if (c < 0x20 || c == '"' || c == '\\' || c >= 0x7f)
            put(line, "\\u%04x", c);
        else
            put(line, "%c", c);
    }
    put(line, "\"");
}

int ddx_stats_json(const DDX_STATS *stats, const char *instance, char *text, size_t size) {
    struct line line = {text, size, 0};

    put(&line, "{\"instance\":");
    put_string(&line, instance, DDX_NAME_MAX);
    put(&line, ",\"in\":%" PRIu64 ",\"out\":%" PRIu64 ",\"waiting\":%" PRIu64 ",\"skipped\":%" PRIu64 ",\"lost\":{",
        stats->in, stats->out, stats->waiting, stats->skipped);
    for (unsigned i = 0; i < stats->reasons && i < DDX_STATS_REASONS; i++) {
        put(&line, i ? "," : "");
        put_string(&line, stats->lost[i].name, sizeof(stats->lost[i].name));
        put(&line, ":%" PRIu64, stats->lost[i].frames);
    }
    put(&line, "},\"latency_us\":{\"p50\":%" PRIu64 ",\"p99\":%" PRIu64 ",\"max\":%" PRIu64 "}",
        ddx_stats_percentile(stats, 0.50), ddx_stats_percentile(stats, 0.99), stats->latency_max);
    put(&line, ",\"latency_until\":\"%s\"", stats->latency_until == DDX_STATS_DISK ? "disk" : "out");
    put(&line, ",\"starts\":%" PRIu32 ",\"first_ns\":%" PRId64 ",\"last_ns\":%" PRId64 "}", stats->starts, stats->first,
        stats->last);
    return (int)line.length;
}
