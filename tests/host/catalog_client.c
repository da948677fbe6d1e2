/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes an item, or reads one of another machine:
 *   catalog_client write ITEM         creates it; for each number N on standard input, writes N values, one a ms
 *   catalog_client read HOST ITEM     prints each value in hexadecimal; HOST "-": this machine
 *   catalog_client items COUNT        holds items i0, i1, ... with a value each until standard input is closed
 *   catalog_client extents ITEM       writes values with another number of bytes each, until standard input is closed
 *   catalog_client visit HOST COUNT   reads the newest value of each of these, and prints their number
 */
#include <ddx.h>
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define PATIENCE 20.0
#define KEEP 240

/* All kinds of fields, and padding between them. */
static const char declaration[] = "struct { int number; char name[5]; struct { double x; short a[3]; } part[2]; "
                                  "float f; unsigned char last; }";

struct value {
    int number;
    char name[5];
    struct {
        double x;
        short a[3];
    } part[2];
    float f;
    unsigned char last;
};

static int failed(const char *what, int error) {
    fprintf(stderr, "%s: %s\n", what, ddx_error_text(error));
    return 1;
}

static void pause_ms(long ms) {
    nanosleep(&(struct timespec){.tv_nsec = ms * 1000000}, NULL);
}

static struct value value_of(int number) {
    struct value value;

    memset(&value, 0, sizeof value);
    value.number = number;
    memcpy(value.name, "abcde", 5);
    for (int i = 0; i < 2; i++) {
        value.part[i].x = number * 1.5 + i;
        for (int k = 0; k < 3; k++)
            value.part[i].a[k] = (short)(number + 10 * i + k);
    }
    value.f = (float)number / 3;
    value.last = (unsigned char)number;
    return value;
}

static int write_values(DDX_STORE_ID *id, const char *name) {
    const struct ddx_item_spec spec = {
        .name = name, .type = "SENSOR", .declaration = declaration, .size = sizeof(struct value)};
    DDX_STORE_ITEM *item;
    int count, number = 0, error = ddx_store_create(id, &spec, &item);

    if (error)
        return failed(name, error);
    while (scanf("%d", &count) == 1) {
        for (; count > 0; count--) {
            struct value value = value_of(++number);

            if ((error = ddx_store_write(item, &value, NULL)))
                return failed(name, error);
            pause_ms(1);
        }
        printf("%d\n", number);
        fflush(stdout);
    }
    return 0;
}

static void print_value(const unsigned char *data, uint64_t size) {
    for (uint64_t i = 0; i < size; i++)
        printf("%02x", data[i]);
    putchar('\n');
    fflush(stdout);
}

static int read_values(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item;
    struct ddx_frame frame;
    int error, tail = DDX_CURRENT;

    while (!(item = ddx_store_lookup_item(id, name, NULL, 0)) && errno == ENOENT)
        pause_ms(20); /* not announced yet */
    if (!item)
        return failed(name, errno);
    if ((error = ddx_store_keep(item, KEEP)))
        return failed("keep", error);
    while (!(error = ddx_store_acquire(item, &frame, PATIENCE, tail))) {
        if (frame.missed)
            fprintf(stderr, "%s: missed %llu\n", name, (unsigned long long)frame.missed);
        print_value(frame.data, sizeof(struct value));
        ddx_store_release(item);
        tail = DDX_IN_ORDER;
    }
    return failed(name, error);
}

static int create_items(DDX_STORE_ID *id, int count) {
    for (int i = 0; i < count; i++) {
        const struct value value = value_of(i);
        char name[16];
        const struct ddx_item_spec spec = {
            .name = name, .type = "SENSOR", .declaration = declaration, .size = sizeof value};
        DDX_STORE_ITEM *item;

        snprintf(name, sizeof name, "i%d", i);
        int error = ddx_store_create(id, &spec, &item);
        if (!error)
            error = ddx_store_write(item, &value, NULL);
        if (error)
            return failed(name, error);
    }
    puts("created");
    fflush(stdout);
    return getchar() != EOF;
}

static int write_extents(DDX_STORE_ID *id, const char *name) {
    struct pollfd end = {.fd = 0, .events = POLLIN};
    struct ddx_extent extent = {.field = "byte"};
    const struct ddx_item_spec spec = {.name = name,
                                       .type = "BYTES",
                                       .declaration = "struct { int count; char byte[1000]; int last; }",
                                       .extents = &extent,
                                       .extent_count = 1};

    do {
        DDX_STORE_ITEM *item;
        void *data;

        extent.bytes = extent.bytes % 9 + 1;
        int error = ddx_store_create(id, &spec, &item);
        if (!error)
            error = ddx_store_loan(item, &data);
        if (error)
            return failed(name, error);
        memset((char *)data + 4, 'x', extent.bytes);
        *(int *)data = *(int *)((char *)data + 1004) = (int)extent.bytes;
        ddx_store_publish(item, NULL);
        pause_ms(40);
        ddx_store_done_item(item);
    } while (!poll(&end, 1, 0));
    printf("%d\n", (int)extent.bytes);
    return 0;
}

/* The items stay open until all have been read. */
static int visit_items(DDX_STORE_ID *id, int count) {
    for (int i = 0; i < count; i++) {
        DDX_STORE_ITEM *item;
        struct ddx_frame frame;
        struct value value;
        char name[16];

        snprintf(name, sizeof name, "i%d", i);
        while (!(item = ddx_store_lookup_item(id, name, NULL, 0)) && errno == ENOENT)
            pause_ms(20);
        int error = item ? ddx_store_acquire(item, &frame, PATIENCE, DDX_CURRENT) : errno;
        if (error)
            return failed(name, error);
        memcpy(&value, frame.data, sizeof value);
        ddx_store_release(item);
        if (value.number != i)
            return failed("value", EBADMSG);
    }
    printf("%d\n", count);
    return 0;
}

int main(int argc, char **argv) {
    const char *host = argc == 4 && strcmp(argv[2], "-") ? argv[2] : NULL;
    DDX_STORE_ID *id = argc > 2 ? ddx_store_open(host, 0, PATIENCE) : NULL;

    if (!id)
        return failed("store", errno);
    if (!strcmp(argv[1], "items"))
        return create_items(id, atoi(argv[2]));
    if (!strcmp(argv[1], "extents"))
        return write_extents(id, argv[2]);
    if (!strcmp(argv[1], "visit"))
        return visit_items(id, atoi(argv[3]));
    return argc == 4 ? read_values(id, argv[3]) : write_values(id, argv[2]);
}
