/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The slot protocol between threads in one address space, so that ThreadSanitizer sees every access. Eight readers of
 * all kinds check every word of 100,000 frames: no frame may be torn, no number may go back.
 */
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../../package/ddx/lib/ring.h"
#include "check.h"

#define READERS 8
#define SLOTS (READERS + 2)
#define WORDS 512
#ifndef FRAMES
#define FRAMES 100000
#endif

static struct ddx_control control;
static struct ddx_notice notice;
static struct ddx_pin_page page[READERS];
static uint64_t slot_data[SLOTS][WORDS];
static atomic_uint torn, backwards;

static uint64_t content(uint64_t sequence, unsigned word) {
    return sequence * 0x9e3779b97f4a7c15u + word;
}

static void nap(long nanoseconds) {
    struct timespec time = {0, nanoseconds};

    nanosleep(&time, NULL);
}

struct party {
    unsigned number;
    uint64_t read, last;
};

/* Even readers read the newest frame, odd ones in order; 1 and 2 are slow at each frame; 3 pauses for a long time. */
static void *reader(void *argument) {
    struct party *party = argument;
    ddx_word *pin = &page[party->number].pin[party->number % DDX_PINS];

    while (party->last < FRAMES) {
        struct ddx_ring_frame frame;
        uint32_t generation, latest;
        unsigned slot =
            party->number % 2 ? ddx_ring_next(&control, party->last, &generation) : ddx_ring_newest(&control, &latest);

        if (slot != DDX_NO_SLOT && party->number % 2 == 0)
            generation = ddx_ring_published(&control, latest);
        if (slot == DDX_NO_SLOT || ddx_ring_pin(&control, pin, slot, generation, &frame))
            continue;
        for (unsigned word = 0; word < WORDS; word++) {
            if (slot_data[slot][word] != content(frame.sequence, word)) {
                atomic_fetch_add(&torn, 1);
                break;
            }
            if (word == WORDS / 2 && (party->number == 1 || party->number == 2))
                nap(20000);
            if (word == WORDS / 2 && party->number == 3 && party->read % 1000 == 0)
                nap(20000000);
        }
        if (frame.sequence < party->last)
            atomic_fetch_add(&backwards, 1);
        party->last = frame.sequence;
        party->read++;
        ddx_ring_unpin(pin);
    }
    return NULL;
}

static void write_all(void) {
    struct ddx_ring_writer writer = {
        .control = &control, .notice = &notice, .epoch = control.epoch, .slot_count = SLOTS, .reader_count = READERS};

    for (unsigned i = 0; i < SLOTS; i++)
        writer.slot[i] = (uint8_t)i;
    for (unsigned i = 0; i < READERS; i++)
        writer.reader[i] = (struct ddx_ring_reader){.page = &page[i], .id = i, .share = 1};
    for (unsigned i = 0; i < FRAMES; i++) {
        unsigned slot;

        CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
        for (unsigned word = 0; word < WORDS; word++)
            slot_data[slot][word] = content(writer.sequence + 1, word);
        if (i % 100 == 99) {
            ddx_ring_cancel(&writer, slot);
            i--;
            CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
            for (unsigned word = 0; word < WORDS; word++)
                slot_data[slot][word] = content(writer.sequence + 1, word);
            i++;
        }
        ddx_ring_publish(&writer, slot, (int64_t)i);
    }
}

/* A reader that claims to hold more than its share does not stop the writer; a reader within its share keeps its
 * frames, even if no other slot is free. */
static void test_shares(void) {
    struct ddx_ring_writer writer = {
        .control = &control, .notice = &notice, .epoch = control.epoch, .slot_count = 2, .reader_count = 1};
    struct ddx_pin_page pins = {.pin = {DDX_PIN(control.epoch, 0), DDX_PIN(control.epoch, 1)}};
    unsigned slot;

    writer.slot[1] = 1;
    writer.reader[0].page = &pins;
    writer.reader[0].share = 1;
    CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
    CHECK_EQUAL(slot, 1);
    ddx_ring_cancel(&writer, slot);
    writer.reader[0].share = 2;
    CHECK_EQUAL(ddx_ring_choose(&writer, &slot), -ENOBUFS);
    atomic_store(&pins.pin[0], DDX_PIN(control.epoch - 1, 0)); /* a pin of another epoch is ignored */
    writer.reader[0].share = 1;
    CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
    CHECK_EQUAL(slot, 0);
    ddx_ring_cancel(&writer, slot);
}

static void reset(void);

/* A frame counts once `latest` names it, also for readers in order: the writer may die before W7. */
static void test_published_means_latest(void) {
    struct ddx_ring_writer writer = {.control = &control, .notice = &notice, .epoch = 7, .slot_count = 3};
    uint32_t generation;
    unsigned slot;

    reset();
    for (unsigned i = 0; i < 3; i++)
        writer.slot[i] = (uint8_t)i;
    CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
    ddx_ring_publish(&writer, slot, 0);
    uint32_t before = atomic_load(&control.latest);
    CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
    ddx_ring_publish(&writer, slot, 0);
    CHECK_EQUAL(ddx_ring_next(&control, 1, &generation), slot);
    atomic_store(&control.latest, before); /* as if the writer had died after W6 */
    CHECK_EQUAL(ddx_ring_next(&control, 1, &generation), DDX_NO_SLOT);
    /* Nor does it count for a reader that follows `latest` and finds another frame in that slot. */
    struct ddx_ring_frame frame;
    uint32_t latest = atomic_load(&control.latest);
    CHECK_EQUAL(
        ddx_ring_pin(&control, &page[0].pin[0], DDX_LATEST_SLOT(latest), ddx_ring_published(&control, latest), &frame),
        0);
    ddx_ring_unpin(&page[0].pin[0]);
    for (int i = 0; i < 2; i++) {
        CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
        ddx_ring_publish(&writer, slot, 0);
    }
    CHECK_EQUAL(slot, DDX_LATEST_SLOT(latest));
    CHECK_EQUAL(ddx_ring_pin(&control, &page[0].pin[0], slot, ddx_ring_published(&control, latest), &frame), -EAGAIN);
}

/* A reader that missed more writes than a generation can count finds the oldest existing frame. */
static void test_long_behind(void) {
    struct ddx_ring_writer writer = {
        .control = &control, .notice = &notice, .epoch = 7, .slot_count = 4, .sequence = UINT64_C(0x280000000) - 3};
    uint64_t first = writer.sequence + 1;
    unsigned slot[6];
    uint32_t generation;
    struct ddx_ring_frame frame;

    reset();
    for (unsigned i = 0; i < 4; i++)
        writer.slot[i] = (uint8_t)i;
    for (unsigned i = 0; i < 6; i++) { /* across a wrap of the low bits */
        CHECK_EQUAL(ddx_ring_choose(&writer, &slot[i]), 0);
        ddx_ring_publish(&writer, slot[i], 0);
    }
    static const uint64_t away[] = {0, 5, 1u << 22, 1u << 23, 1u << 30, 1u << 31, UINT64_C(1) << 32};
    for (unsigned i = 0; i < sizeof away / sizeof *away; i++) {
        uint64_t seen = first + 1 - away[i], wanted = seen < first + 2 ? first + 2 : seen + 1;

        CHECK_EQUAL(ddx_ring_next(&control, seen, &generation), slot[wanted - first]);
        CHECK_EQUAL(ddx_ring_pin(&control, &page[0].pin[0], slot[wanted - first], generation, &frame), 0);
        CHECK_EQUAL(frame.sequence, wanted);
        ddx_ring_unpin(&page[0].pin[0]);
    }
    CHECK_EQUAL(ddx_ring_next(&control, first + 4, &generation), slot[5]);
    CHECK_EQUAL(ddx_ring_next(&control, first + 5, &generation), DDX_NO_SLOT);
}

static void reset(void) {
    memset(&control, 0, sizeof control);
    control.epoch = 7;
    atomic_store(&control.slots, SLOTS);
    atomic_store(&control.latest, DDX_LATEST(0, DDX_NO_SLOT));
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        atomic_store(&control.slot[i].generation, DDX_EMPTY);
}

int main(void) {
    test_published_means_latest();
    test_long_behind();
    pthread_t thread[READERS];
    struct party party[READERS];

    reset();
    if (!getenv("DDX_BROKEN")) /* a writer that ignores pins is never blocked by a reader */
        test_shares();
    reset();
    for (unsigned i = 0; i < READERS; i++) {
        party[i] = (struct party){.number = i};
        CHECK_EQUAL(pthread_create(&thread[i], NULL, reader, &party[i]), 0);
    }
    write_all();
    for (unsigned i = 0; i < READERS; i++) {
        pthread_join(thread[i], NULL);
        printf("reader %u: %llu frames, last %llu\n", i, (unsigned long long)party[i].read,
               (unsigned long long)party[i].last);
    }
    printf("torn %u, backwards %u\n", atomic_load(&torn), atomic_load(&backwards));
    CHECK_NO_FRAMES(atomic_load(&torn));
    CHECK_NO_FRAMES(atomic_load(&backwards));
    return 0;
}
