/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes and reads values for bench/catalog.py: through the store and the catalog, or by Cyclone DDS alone, with
 * the catalog's own settings of it.
 *   catalog write store|dds NAME HZ       a value of 142 bytes HZ times a second
 *   catalog frames dds TOPIC HZ           an Image of CIF, rgb8
 *   catalog read store HOST:NAME          microseconds from each write to its arrival
 *   catalog read dds NAME
 *   catalog first store HOST:NAME...      milliseconds from the look for each item to its first value
 * Writers write as many values as each line of standard input says, and answer when that is done. Readers print a
 * number a line, "-1" for values that they missed.
 */
#include <ddx.h>
#include <errno.h>
#include <inttypes.h>
#include <network.h>
#include <standard.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define VALUE 142
#define PATIENCE 20.0
#define KEEP 64
#define SECOND INT64_C(1000000000)
#define HEADER 4 /* of CDR */
#define WIDTH 352
#define HEIGHT 288
#define FRAME (3 * WIDTH * HEIGHT)

static const char declaration[] = "struct { unsigned char data[142]; }";
static const char schema[] = "uint8[142] data\n";

/* The fields before the pixels of an Image, in CDR. */
static const struct {
    uint32_t seconds, nanoseconds, frame_id_size;
    char frame_id[4];
    uint32_t height, width, encoding_size;
    char encoding[5];
    unsigned char is_bigendian, padding[2];
    uint32_t step, size;
} before = {1, 0, 2, "r", HEIGHT, WIDTH, 5, "rgb8", 0, {0}, 3 * WIDTH, FRAME};

/* One of a value's two ways. */
struct writer {
    const char *name;
    size_t size;
    DDX_STORE_ITEM *item;
    struct network *network;
    struct network_writer *writer;
    unsigned char message[HEADER + sizeof before + FRAME + 4];
    uint64_t number;
};

static int failed(const char *what, int error) {
    fprintf(stderr, "%s: %s\n", what, ddx_error_text(error));
    return 1;
}

/* A reader sees by the number whether it has missed any. */
struct stamp {
    uint64_t number;
    int64_t time;
};

static void arrived(const unsigned char *data) {
    static uint64_t expected;
    struct stamp stamp;

    memcpy(&stamp, data, sizeof stamp);
    for (; expected && expected < stamp.number; expected++)
        puts("-1");
    expected = stamp.number + 1;
    printf("%.1f\n", (double)(ddx_time_now() - stamp.time) / 1000);
    fflush(stdout);
}

static void nothing(void *argument) {
    (void)argument;
}

static const struct network_event no_event = {nothing, NULL};

static int open_network(struct network **network) {
    const struct network_options options = {.interface = NULL};

    return network_open(&options, network);
}

static int describe(bool image, struct description **description) {
    char why[STANDARD_WHY];
    struct standard *standard;
    int error = image ? standard_open("sensor_msgs/msg/Image", NULL, &standard, why)
                      : description_parse("bench/msg/VALUE", schema, description);

    if (!error && image)
        *description = standard->description;
    return error;
}

static int open_dds(struct writer *writer) {
    struct description *description;
    int error = open_network(&writer->network);

    if (!error)
        error = describe(writer->size != VALUE, &description);
    if (!error)
        error = network_writer_open(writer->network, writer->name, description, writer->size, false, &no_event,
                                    &writer->writer);
    for (unsigned came; !error && !network_writer_readers(writer->writer, &came);)
        network_wait(writer->network, 0.01);
    return error;
}

static int open_item(struct writer *writer) {
    const struct ddx_item_spec spec = {
        .name = writer->name, .type = "VALUE", .declaration = declaration, .size = VALUE};
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, PATIENCE);

    return id ? ddx_store_create(id, &spec, &writer->item) : -errno;
}

static int write_one(struct writer *writer) {
    const struct stamp stamp = {++writer->number, ddx_time_now()};
    bool image = writer->size != VALUE;
    unsigned char *data = writer->item ? writer->message : writer->message + HEADER;

    if (!image) {
        memset(data, 0xa5, VALUE);
        memcpy(data, &stamp, sizeof stamp);
    }
    return writer->item ? ddx_store_write(writer->item, data, NULL)
                        : network_write(writer->writer, writer->message, HEADER + writer->size, stamp.time);
}

static int write_values(struct writer *writer, double rate) {
    int64_t period = (int64_t)(SECOND / rate);
    unsigned count;

    puts("ready");
    fflush(stdout);
    while (scanf("%u", &count) == 1) {
        int64_t due = ddx_time_now();

        for (; count; count--) {
            due += period;
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &(struct timespec){due / SECOND, due % SECOND}, NULL);
            int error = write_one(writer);
            if (error && error != -EAGAIN)
                return failed(writer->name, error);
        }
        printf("%" PRIu64 "\n", writer->number);
        fflush(stdout);
    }
    return 0;
}

static int write_by(const char *way, const char *name, size_t size, double rate) {
    static struct writer writer;

    writer = (struct writer){.name = name, .size = size, .message = {0, 1}};
    if (size != VALUE)
        memcpy(writer.message + HEADER, &before, sizeof before);
    int error = strcmp(way, "dds") ? open_item(&writer) : open_dds(&writer);
    return error ? failed(name, error) : write_values(&writer, rate);
}

static void take(void *argument, uint64_t writer, const unsigned char *message, size_t size) {
    (void)argument, (void)writer;
    if (size >= HEADER + VALUE)
        arrived(message + HEADER);
}

static struct network_reader *reader;

static void ready(void *argument) {
    (void)argument;
    network_read(reader, take, NULL);
}

static int read_dds(const char *topic) {
    static const struct network_event event = {ready, NULL};
    struct description *description;
    struct network *network;
    int error = open_network(&network);

    if (!error)
        error = describe(false, &description);
    if (!error)
        error = network_reader_open(network, topic, description, VALUE, &event, &reader);
    if (error)
        return failed(topic, error);
    for (;;)
        network_wait(network, 1);
}

static DDX_STORE_ITEM *look_up(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item;

    while (!(item = ddx_store_lookup_item(id, name, NULL, 0)) && (errno == ENOENT || errno == EHOSTUNREACH))
        nanosleep(&(struct timespec){.tv_nsec = 20000000}, NULL);
    return item;
}

static int read_item(const char *name) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, PATIENCE);
    DDX_STORE_ITEM *item = id ? look_up(id, name) : NULL;
    struct ddx_frame frame;
    int error = item ? ddx_store_keep(item, KEEP) : -errno;

    while (!error) {
        error = ddx_store_acquire(item, &frame, PATIENCE, DDX_IN_ORDER);
        if (error == -ETIMEDOUT)
            error = 0;
        else if (!error) {
            arrived(frame.data);
            ddx_store_release(item);
        }
    }
    return failed(name, error);
}

static int first_values(char **names) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, PATIENCE);
    struct ddx_frame frame;
    int error = id ? 0 : -errno;

    for (; !error && *names; names++) {
        int64_t begin = ddx_time_now();
        DDX_STORE_ITEM *item = ddx_store_lookup_item(id, *names, NULL, 0);

        error = item ? ddx_store_acquire(item, &frame, PATIENCE, DDX_CURRENT) : -errno;
        if (!error)
            printf("%.1f\n", (double)(ddx_time_now() - begin) / 1e6);
    }
    return error ? failed("first", error) : 0;
}

int main(int argc, char **argv) {
    const char *what = argc > 3 ? argv[1] : "";

    if (!strcmp(what, "first"))
        return first_values(argv + 3);
    if (!strcmp(what, "read"))
        return strcmp(argv[2], "dds") ? read_item(argv[3]) : read_dds(argv[3]);
    if (argc == 5 && (!strcmp(what, "write") || !strcmp(what, "frames")))
        return write_by(argv[2], argv[3], strcmp(what, "write") ? sizeof before + FRAME : VALUE, atof(argv[4]));
    fputs("usage: see bench/catalog.c\n", stderr);
    return 2;
}
