/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One writer or one reader of a measurement: `bench-PEER key=value...`, started by bench/store.py. Says "ready", waits
 * for a line, measures, prints its findings as one line of JSON, and waits for the end of its input before it leaves.
 *
 * Each page of a frame begins with its mark: the frame's number and the page's. The writer writes every mark, the
 * reader checks every mark, so both touch every page, and a torn or stale frame is found. Latency: from the writer's
 * look at the clock just before it publishes to the reader's just after it has checked the whole frame.
 */
#include <glob.h>
#include <inttypes.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "peer.h"

#define PAGE 4096u
#define SECOND 1000000000
#define PATIENCE 50 /* times peer_receive() may come back empty before the reader gives up */

struct head { /* of a frame's first page */
    uint64_t mark;
    int64_t published; /* ns */
};

static struct peer_setup setup = {.name = "bench", .bytes = PAGE, .readers = 1};
static unsigned long frames = 100, warm_up = 10, interval_us = 5000;
static unsigned long skip, tear, late_us; /* faults, to see whether they are noticed */
static bool writer;

static struct {
    unsigned long frames, lost, torn, last;
    int64_t cpu_begin, cpu_end, queued;
    int32_t *latency;
    bool over;
} result;

static int64_t now(clockid_t clock) {
    struct timespec time;

    clock_gettime(clock, &time);
    return (int64_t)time.tv_sec * SECOND + time.tv_nsec;
}

/* ns that this process was ready to run and others had its core, all its threads together. */
static int64_t queued(void) {
    int64_t sum = 0;
    glob_t found;

    if (glob("/proc/self/task/*/schedstat", 0, NULL, &found))
        return 0;
    for (size_t i = 0; i < found.gl_pathc; i++) {
        FILE *file = fopen(found.gl_pathv[i], "r");
        long long waited;

        if (file && fscanf(file, "%*s %lld", &waited) == 1)
            sum += waited;
        if (file)
            fclose(file);
    }
    globfree(&found);
    return sum;
}

static uint64_t mark(unsigned long number, size_t page) {
    return (uint64_t)number << 20 | page;
}

static void fill(char *frame, unsigned long number) {
    for (size_t at = 0; at < setup.bytes; at += PAGE) {
        uint64_t value = mark(number, at / PAGE) ^ (number == tear && at / PAGE == setup.bytes / PAGE / 2);

        memcpy(frame + at, &value, sizeof value);
    }
}

static unsigned long check(const char *frame, bool *torn) {
    struct head head;

    memcpy(&head, frame, sizeof head);
    *torn = false;
    for (size_t at = 0; at < setup.bytes; at += PAGE) {
        uint64_t value;

        memcpy(&value, frame + at, sizeof value);
        *torn |= value != mark((unsigned long)(head.mark >> 20), at / PAGE);
    }
    return (unsigned long)(head.mark >> 20);
}

static void deliver(const void *data) {
    struct head head;
    bool torn;
    unsigned long number = check(data, &torn);
    int64_t time = now(CLOCK_MONOTONIC);

    memcpy(&head, data, sizeof head);
    if (torn || number <= result.last || number > warm_up + frames) {
        result.torn++; /* or seen before */
        return;
    }
    if (number > warm_up) {
        /* The CPU time from the first frame to the last: as many deliveries as lie between them. */
        if (!result.cpu_begin)
            result.cpu_begin = now(CLOCK_PROCESS_CPUTIME_ID);
        else
            result.cpu_end = now(CLOCK_PROCESS_CPUTIME_ID);
        result.lost += number - (result.last > warm_up ? result.last : warm_up) - 1;
        result.latency[result.frames++] = (int32_t)(time - head.published);
    }
    result.last = number;
    result.over = number == warm_up + frames;
}

static int read_all(void) {
    for (int empty = 0; !result.over && empty < PATIENCE; empty++) {
        unsigned long before = result.last;

        if (peer_receive(deliver))
            return 1;
        if (result.last != before)
            empty = -1;
    }
    /* Frames that had not come when the last one came. */
    result.lost += warm_up + frames - (result.last > warm_up ? result.last : warm_up);
    return 0;
}

static int write_one(unsigned long number) {
    char *frame = setup.mode == PEER_COPY ? setup.own : peer_loan();

    if (!frame)
        return 1;
    fill(frame, number);
    int64_t time = now(CLOCK_MONOTONIC);
    memcpy(frame + offsetof(struct head, published), &time, sizeof time);
    if (late_us)
        nanosleep(&(struct timespec){0, (long)late_us * 1000}, NULL);
    return setup.mode == PEER_COPY ? peer_write(setup.own) : peer_publish();
}

static int write_all(void) {
    int64_t next = now(CLOCK_MONOTONIC);

    for (unsigned long number = 1; number <= warm_up + frames; number++) {
        next += (int64_t)interval_us * 1000;
        struct timespec time = {next / SECOND, next % SECOND};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, NULL))
            ;
        if (number == warm_up + 1)
            result.cpu_begin = now(CLOCK_PROCESS_CPUTIME_ID);
        if (number != skip && write_one(number))
            return 1;
    }
    result.cpu_end = now(CLOCK_PROCESS_CPUTIME_ID);
    result.frames = frames;
    return 0;
}

static int options(int argc, char **argv) {
    static const char *const modes[] = {"zerocopy", "copy", "direct"};
    const struct {
        const char *key;
        unsigned long *value;
    } numbers[] = {{"frames", &frames}, {"warm-up", &warm_up}, {"interval", &interval_us},
                   {"skip", &skip},     {"tear", &tear},       {"late", &late_us}};

    for (int i = 1; i < argc; i++) {
        char *value = strchr(argv[i], '=');
        bool known = false;

        if (!value)
            return 1;
        *value++ = '\0';
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
            if (!strcmp(argv[i], numbers[k].key)) {
                *numbers[k].value = strtoul(value, NULL, 10);
                known = true;
            }
        for (unsigned mode = 0; mode < 3 && !strcmp(argv[i], "mode"); mode++)
            if (!strcmp(value, modes[mode])) {
                setup.mode = (enum peer_mode)mode;
                known = true;
            }
        if (!strcmp(argv[i], "role"))
            writer = !strcmp(value, "writer");
        else if (!strcmp(argv[i], "name"))
            setup.name = value;
        else if (!strcmp(argv[i], "bytes"))
            setup.bytes = strtoul(value, NULL, 10);
        else if (!strcmp(argv[i], "readers"))
            setup.readers = (unsigned)strtoul(value, NULL, 10);
        else if (!strcmp(argv[i], "cpu")) {
            cpu_set_t set;

            CPU_ZERO(&set);
            CPU_SET(strtoul(value, NULL, 10), &set);
            if (sched_setaffinity(0, sizeof set, &set))
                return 1;
        } else if (!known)
            return 1;
    }
    return setup.bytes < PAGE || !frames;
}

int main(int argc, char **argv) {
    char line[8];

    if (options(argc, argv)) {
        fprintf(stderr,
                "usage: %s role=writer|reader mode=zerocopy|copy|direct name= bytes= readers= frames= "
                "warm-up= interval=US cpu=\n",
                argv[0]);
        return 2;
    }
    result.latency = calloc(frames, sizeof *result.latency);
    setup.own = aligned_alloc(PAGE, (setup.bytes + PAGE - 1) / PAGE * PAGE);
    if (!result.latency || !setup.own)
        return 1;
    memset(result.latency, 1, frames * sizeof *result.latency); /* no page faults later */
    memset(setup.own, 1, setup.bytes);
    if (peer_open(&setup, writer))
        return 1;
    puts("ready");
    fflush(stdout);
    if (!fgets(line, sizeof line, stdin))
        return 1;
    result.queued = -queued();
    if (writer ? write_all() : read_all())
        return 1;
    result.queued += queued();
    printf("{\"frames\": %lu, \"lost\": %lu, \"torn\": %lu, \"cpu_ns\": %" PRId64 ", \"queued_ns\": %" PRId64
           ", \"latency_ns\": [",
           result.frames, result.lost, result.torn, result.cpu_end - result.cpu_begin, result.queued);
    for (unsigned long i = 0; i < result.frames && !writer; i++)
        printf("%s%" PRId32, i ? "," : "", result.latency[i]);
    puts("]}");
    fflush(stdout);
    while (fgets(line, sizeof line, stdin))
        ;
    peer_close();
    return 0;
}
