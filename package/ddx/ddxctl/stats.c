/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_stats.h"
#include "ddxctl.h"

#define SUFFIX ".stats"
#define TYPE "DDX_STATS"
#define PACKETS ".packets"

/* Any program can write the counters' item: print no control characters. */
static void print_text(const char *text, size_t length) {
    for (size_t i = 0; i < length && text[i]; i++)
        putchar(text[i] < ' ' || text[i] > '~' ? '?' : text[i]);
}

static void print_line(const DDX_STATS *stats, const char *instance) {
    uint64_t lost = 0;

    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        lost += stats->lost[i].frames;
    printf("%-24s in %llu, out %llu, waiting %llu, lost %llu", instance, (unsigned long long)stats->in,
           (unsigned long long)stats->out, (unsigned long long)stats->waiting, (unsigned long long)lost);
    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats->reasons; i++)
        if (stats->lost[i].frames) {
            printf(" (");
            print_text(stats->lost[i].name, sizeof stats->lost[i].name);
            printf(" %llu)", (unsigned long long)stats->lost[i].frames);
        }
    if (stats->skipped)
        printf(", skipped %llu", (unsigned long long)stats->skipped);
    printf(", %s us p50 %llu, p99 %llu, max %llu, starts %u%s",
           stats->latency_until == DDX_STATS_DISK ? "until on disk" : "latency",
           (unsigned long long)ddx_stats_percentile(stats, 0.5), (unsigned long long)ddx_stats_percentile(stats, 0.99),
           (unsigned long long)stats->latency_max, (unsigned)stats->starts, stats->running ? "" : ", stopped");
}

/* One program's counters. The handles remain open between repetitions, so that reading again costs only a copy. */
struct book {
    char name[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *item;
    DDX_STORE_ITEM *packets; /* a sender's packet counters; or NULL */
    DDX_STATS stats;
    int result;
};

/* Fields of `<instance>.packets` that are shown too, in text with these words around them. */
static const struct {
    const char *field, *before, *after;
    bool tenths;
} rates[] = {{"wire_kbit", "wire", " kbit/s", false},      {"repair_percent", "repair", " %", false},
             {"video_kbit", "video", " kbit/s", false},    {"repair_kbit", "repair", " kbit/s", false},
             {"loss_percent", "loss", " %", false},        {"run_tenths", "runs of", "", true},
             {"freeze_ms", "longest freeze", " ms", false}};

static struct book *books;
static unsigned book_count;

static bool is_book(const struct ddx_item_info *info) {
    size_t length = strlen(info->name);

    return length > strlen(SUFFIX) && !strcmp(info->name + length - strlen(SUFFIX), SUFFIX) &&
           !strcmp(info->type, TYPE);
}

/* A sender may create its packet counters later than its book. */
static void find_packets(DDX_STORE_ID *id, struct book *book) {
    char name[DDX_NAME_MAX + 1];
    int length = (int)(strlen(book->name) - strlen(SUFFIX));

    if (!book->packets && snprintf(name, sizeof name, "%.*s" PACKETS, length, book->name) < (int)sizeof name)
        book->packets = ddx_store_lookup_item(id, name, NULL, 0);
}

static struct book *find_book(const char *name) {
    for (unsigned i = 0; i < book_count; i++)
        if (!strcmp(books[i].name, name))
            return &books[i];
    return NULL;
}

static int open_book(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    struct book *more;

    if (!item)
        return errno == ENOENT ? 0 : -errno; /* dropped since the list was made */
    if (strcmp(ddx_store_item_type(item), TYPE) != 0) {
        ddx_store_done_item(item); /* another item has the name since then */
        return 0;
    }
    more = realloc(books, (book_count + 1) * sizeof *books);
    if (!more)
        return -ENOMEM;
    books = more;
    books[book_count] = (struct book){.item = item};
    strcpy(books[book_count++].name, name);
    return 0;
}

static void close_book(unsigned index) {
    ddx_store_done_item(books[index].item);
    ddx_store_done_item(books[index].packets);
    memmove(&books[index], &books[index + 1], (--book_count - index) * sizeof *books);
}

/* Open handles on new books, and close those of dropped ones. */
static int follow(DDX_STORE_ID *id, const struct ddx_item_info *items, unsigned count) {
    int result = 0;

    for (unsigned i = book_count; i-- > 0;) {
        unsigned k = 0;

        while (k < count && strcmp(items[k].name, books[i].name) != 0)
            k++;
        if (k == count)
            close_book(i);
    }
    for (unsigned i = 0; i < count && !result; i++)
        if (is_book(&items[i]) && !find_book(items[i].name))
            result = open_book(id, items[i].name);
    return result;
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct book *)a)->name, ((const struct book *)b)->name);
}

static const uint64_t *number_of(const DDX_STORE_ITEM *item, const struct ddx_frame *frame, const char *name) {
    const struct ddx_field *field = ddx_store_field_named(item, name);

    if (!field || field->kind != DDX_KIND_UNSIGNED || field->bytes != sizeof(uint64_t) || field->count != 1)
        return NULL;
    return (const uint64_t *)((const char *)frame->data + field->offset);
}

/* What a stream and its link do now. */
static void print_rates(DDX_STORE_ITEM *packets, bool json) {
    struct ddx_frame frame;

    if (!packets || ddx_store_acquire(packets, &frame, 0, DDX_CURRENT))
        return;
    for (unsigned i = 0; i < sizeof rates / sizeof *rates; i++) {
        const uint64_t *number = number_of(packets, &frame, rates[i].field);

        if (number && json)
            printf(",\"%s\":%llu", rates[i].field, (unsigned long long)*number);
        else if (number && rates[i].tenths)
            printf(", %s %.1f%s", rates[i].before, (double)*number / 10, rates[i].after);
        else if (number)
            printf(", %s %llu%s", rates[i].before, (unsigned long long)*number, rates[i].after);
    }
    ddx_store_release(packets);
}

static void print_book(const struct book *book, bool json) {
    char instance[DDX_NAME_MAX + 1], line[DDX_STATS_LINE_MAX];
    DDX_STORE_ITEM *packets = book->stats.running ? book->packets : NULL;

    snprintf(instance, sizeof instance, "%.*s", (int)(strlen(book->name) - strlen(SUFFIX)), book->name);
    if (json) {
        int length = ddx_stats_json(&book->stats, instance, line, sizeof line);

        printf("%.*s", length - 1, line); /* its last brace comes after the rates */
        print_rates(packets, true);
        puts("}");
    } else {
        print_line(&book->stats, instance);
        print_rates(packets, false);
        putchar('\n');
    }
}

int command_stats(DDX_STORE_ID *id, const struct request *request) {
    struct ddx_item_info *items;
    unsigned count;
    int status = 0, result = ddx_store_list(id, NULL, &items, &count);

    if (!result) {
        result = follow(id, items, count);
        free(items);
    }
    if (result)
        return complain(NULL, result);
    for (unsigned i = 0; i < book_count; i++)
        find_packets(id, &books[i]);
    if (book_count)
        qsort(books, book_count, sizeof *books, by_name);
    /* The first read takes a while, since the store must admit the handle. The second round reads all books at nearly
     * the same time, so that counters of programs that pass frames to each other fit together. */
    for (int round = 0; round < 2; round++)
        for (unsigned i = 0; i < book_count; i++)
            books[i].result = ddx_store_read(books[i].item, &books[i].stats, NULL, 0, DDX_CURRENT);
    for (unsigned i = 0; i < book_count; i++) {
        if (!books[i].result)
            print_book(&books[i], request->json);
        else if (books[i].result != -ETIMEDOUT) /* else its program has only just begun */
            status = complain(books[i].name, books[i].result);
    }
    fflush(stdout);
    return status;
}
