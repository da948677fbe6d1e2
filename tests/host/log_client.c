/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * log_client NAME FIRST COUNT MICROSECONDS READERS [LAYOUT]: writes an item whose values contain their numbers: FIRST
 * to FIRST + COUNT - 1, MICROSECONDS apart, once there are READERS readers. Prints "<number> <time>" for each. LAYOUT:
 * sample, other (other fields), extent (an array used in part), int, noise (does not compress).
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "ddx.h"

DDX_STORE_TYPE(
    SAMPLE, struct {
        uint8_t flag;
        int64_t number;
        float ratio;
        char text[12];
        struct {
            int8_t small;
            double wide;
            struct {
                short x, y;
            } corner[2];
        } part[3];
        double gearsLeft[2][2];
        uint16_t last;
    });
DDX_STORE_TYPE(
    OTHER, struct {
        double number;
        int count;
    });

DDX_STORE_TYPE(
    NOISE, struct {
        int64_t number;
        uint32_t word[1000];
    });

static SAMPLE sample_of(int64_t number) {
    SAMPLE sample;
    memset(&sample, 0, sizeof(sample));
    sample.flag = (uint8_t)number;
    sample.number = number;
    sample.ratio = (float)number / 3;
    snprintf(sample.text, sizeof(sample.text), "n%lld", (long long)number % 1000000);
    for (int i = 0; i < 3; i++) {
        sample.part[i].small = (int8_t)(number + i);
        sample.part[i].wide = (double)number / 7 + i;
        for (int k = 0; k < 2; k++) {
            sample.part[i].corner[k].x = (short)(number * 2 + i + k);
            sample.part[i].corner[k].y = (short)(-number - i - k);
        }
    }
    for (int i = 0; i < 4; i++)
        sample.gearsLeft[i / 2][i % 2] = (double)number + i / 4.0;
    sample.last = (uint16_t)(number * 3);
    return sample;
}

static DDX_STORE_ITEM *create(DDX_STORE_ID *id, const char *name, const char *layout) {
    const struct ddx_extent extent = {"row", 1000};
    struct ddx_item_spec spec = {.name = name, .type = "SAMPLE", .size = sizeof(SAMPLE)};
    DDX_STORE_ITEM *item;
    if (!strcmp(layout, "other"))
        spec = (struct ddx_item_spec){.name = name, .type = "OTHER", .size = sizeof(OTHER)};
    if (!strcmp(layout, "int"))
        spec = (struct ddx_item_spec){.name = name, .type = "int", .declaration = "int", .size = sizeof(int)};
    if (!strcmp(layout, "extent"))
        spec = (struct ddx_item_spec){.name = name,
                                      .type = "ROWS",
                                      .declaration = "struct { int64_t number; char row[100000]; int end; }",
                                      .extents = &extent,
                                      .extent_count = 1};
    if (!strcmp(layout, "noise"))
        spec = (struct ddx_item_spec){.name = name, .type = "NOISE", .size = sizeof(NOISE)};
    int error;
    for (int i = 0; (error = ddx_store_create(id, &spec, &item)) && i < 200; i++)
        usleep(100000);
    if (!error)
        return item;
    fprintf(stderr, "log_client: %s: %s\n", name, ddx_error_text(error));
    exit(1);
}

static int write_value(DDX_STORE_ITEM *item, const char *layout, int64_t number, DDX_TIME time) {
    SAMPLE sample = sample_of(number);
    OTHER other;
    int plain = (int)number;
    void *data;
    if (!strcmp(layout, "int"))
        return ddx_store_write(item, &plain, &time);
    if (!strcmp(layout, "noise")) {
        static NOISE noise;
        noise.number = number;
        for (int i = 0; i < 1000; i++)
            noise.word[i] = (uint32_t)random();
        return ddx_store_write(item, &noise, &time);
    }
    if (!strcmp(layout, "other")) {
        memset(&other, 0, sizeof(other));
        other.number = (double)number / 2;
        other.count = (int)number;
        return ddx_store_write(item, &other, &time);
    }
    if (strcmp(layout, "extent"))
        return ddx_store_write(item, &sample, &time);
    int error = ddx_store_loan(item, &data);
    if (error)
        return error;
    memcpy(data, &number, sizeof(number));
    memset((char *)data + 8, (int)number, 1000);
    memcpy((char *)data + ddx_store_field_named(item, "end")->offset, &plain, sizeof(plain));
    return ddx_store_publish(item, &time);
}

int main(int argc, char **argv) {
    if (argc < 6)
        return 2;
    const char *layout = argc > 6 ? argv[6] : "sample";
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5);
    DDX_STORE_ITEM *item = id ? create(id, argv[1], layout) : NULL;
    int64_t first = atoll(argv[2]), count = atoll(argv[3]), step = atoll(argv[4]) * 1000;
    if (!item)
        return 1;
    while (ddx_store_readers(item) < atoi(argv[5]))
        usleep(1000);
    int64_t begin = ddx_time_now();
    for (int64_t i = 0; i < count; i++) {
        int64_t due = begin + i * step;
        struct timespec until = {due / 1000000000, due % 1000000000};
        if (step)
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
        DDX_TIME now = ddx_time_now();
        int error = write_value(item, layout, first + i, now);
        if (error) {
            fprintf(stderr, "log_client: %s: %s\n", argv[1], ddx_error_text(error));
            return 1;
        }
        printf("%lld %lld\n", (long long)(first + i), (long long)now);
    }
    fflush(stdout);
    ddx_store_close(id);
    return 0;
}
