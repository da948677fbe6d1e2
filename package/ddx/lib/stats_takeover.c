/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A restarted program continues the totals of the previous one, so that in = out + lost holds across restarts. */
#include <errno.h>
#include <string.h>

#include "stats_book.h"

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
