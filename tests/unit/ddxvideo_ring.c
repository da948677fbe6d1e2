/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The recorder's ring: what goes in comes out in order, a full ring refuses and loses nothing else. */
#include <errno.h>
#include <unistd.h>

#include "check.h"
#include "ring.h"

#define FRAMES 16
#define FRAME_BYTES 700001 /* neither fits the ring's size nor any alignment */
#define TOTAL 400

static unsigned char byte_of(uint64_t position) {
    return (unsigned char)(position * 2654435761u >> 24);
}

static void fill(unsigned char *bytes, uint64_t position, size_t size) {
    for (size_t i = 0; i < size; i++)
        bytes[i] = byte_of(position + i);
}

/* All that is ready, at most `limit`; 0 at the end. */
static size_t peek(struct ring *ring, const unsigned char **bytes, size_t limit) {
    size_t size = 0;
    return ring_peek(ring, bytes, &size, limit) == RING_BYTES ? size : 0;
}

static void test_full(void) {
    struct ring ring;
    unsigned char frame[100] = {0};
    const unsigned char *bytes;
    struct ring_frame out;
    const struct iovec pieces[2] = {{(void *)(uintptr_t)"header", 6}, {frame, sizeof(frame)}};
    CHECK(!ring_init(&ring, 4, sizeof(frame)));
    CHECK(ring_put(&ring, pieces, 2, &(struct ring_facts){.header = 6}));
    for (int i = 1; i < 4; i++)
        CHECK(ring_put(&ring, pieces + 1, 1, &(struct ring_facts){.frame = i}));
    CHECK(ring_level(&ring) == 100);
    CHECK(!ring_put(&ring, pieces + 1, 1, &(struct ring_facts){.frame = 4})); /* bytes would fit: as many as frames */
    CHECK_EQUAL(peek(&ring, &bytes, 1000), 406);
    CHECK(!memcmp(bytes, "header", 6));
    CHECK(ring_oldest(&ring, &out));
    CHECK_EQUAL(out.begin, 6);
    CHECK_EQUAL(out.end, 106);
    ring_take(&ring, 406);
    for (int i = 0; i < 4; i++) {
        CHECK(ring_oldest(&ring, &out));
        CHECK_EQUAL(out.facts.frame, i);
        CHECK_EQUAL(out.end, 106 + (unsigned)i * 100);
        ring_drop_oldest(&ring);
    }
    CHECK(!ring_oldest(&ring, &out));
    CHECK(ring_put(&ring, pieces + 1, 1, &(struct ring_facts){.frame = 4}));
    ring_close(&ring);
    CHECK_EQUAL(peek(&ring, &bytes, 1000), 100);
    ring_take(&ring, 100);
    CHECK_EQUAL(peek(&ring, &bytes, 1000), 0);
    ring_free(&ring);
    CHECK(ring_init(&ring, 1000000, SIZE_MAX / 100) == -ENOMEM);
}

/* Files begin at blocks; of a block that was taken in part nothing is overwritten. */
static void test_cuts(void) {
    struct ring ring;
    static unsigned char frame[RING_BLOCK];
    const unsigned char *bytes, *before;
    size_t size;
    const struct iovec piece = {frame, 1000};
    CHECK(!ring_init(&ring, 1000, 1000));
    memset(frame, 1, sizeof(frame));
    CHECK(ring_put(&ring, &piece, 1, &(struct ring_facts){0}));
    CHECK_EQUAL(peek(&ring, &before, 5000), 1000);
    ring_take(&ring, 1000);
    memset(frame, 2, sizeof(frame));
    CHECK(ring_put(&ring, &piece, 1, &(struct ring_facts){0}));
    CHECK(ring_cut(&ring));
    memset(frame, 3, sizeof(frame));
    CHECK(ring_put(&ring, &piece, 1, &(struct ring_facts){0}));
    CHECK_EQUAL(peek(&ring, &bytes, 5000), 1000);
    CHECK(bytes == before + 1000 && bytes[0] == 2 && before[0] == 1);
    ring_take(&ring, 1000);
    CHECK(ring_peek(&ring, &bytes, &size, 5000) == RING_CUT);
    CHECK_EQUAL(ring_next_file(&ring), RING_BLOCK);
    CHECK_EQUAL(peek(&ring, &bytes, 5000), 1000);
    CHECK(bytes == before + RING_BLOCK && bytes[0] == 3 && !((uintptr_t)bytes % RING_BLOCK));
    for (int i = 0; i < RING_CUTS; i++)
        CHECK(ring_cut(&ring));
    CHECK(!ring_cut(&ring));
    ring_free(&ring);
}

static void *drain(void *argument) {
    struct ring *ring = argument;
    const unsigned char *bytes;
    uint64_t position = 0;
    int64_t frames = 0;
    size_t size;
    while ((size = peek(ring, &bytes, 1 << 20))) {
        size -= size / 3; /* a disk that takes less than it is given */
        for (size_t i = 0; i < size; i += 997)
            if (bytes[i] != byte_of(position + i)) {
                fprintf(stderr, "byte %" PRIu64 " is wrong\n", position + i);
                exit(1);
            }
        position += size;
        ring_take(ring, size);
        struct ring_frame frame;
        for (; ring_oldest(ring, &frame) && frame.end <= position; ring_drop_oldest(ring), frames++)
            CHECK_EQUAL(frame.facts.frame, frames);
    }
    return (void *)(intptr_t)frames;
}

static void test_two_threads(void) {
    struct ring ring;
    pthread_t thread;
    static unsigned char frame[FRAME_BYTES];
    void *frames;
    CHECK(!ring_init(&ring, FRAMES, FRAME_BYTES));
    CHECK(!pthread_create(&thread, NULL, drain, &ring));
    uint64_t position = 0;
    for (int i = 0; i < TOTAL; i++) {
        size_t size = 1 + (size_t)i * 7919 % FRAME_BYTES;
        fill(frame, position, size);
        const struct iovec pieces[2] = {{frame, size / 2}, {frame + size / 2, size - size / 2}};
        while (!ring_put(&ring, pieces, 2, &(struct ring_facts){.frame = i}))
            usleep(100);
        position += size;
    }
    ring_close(&ring);
    pthread_join(thread, &frames);
    CHECK_EQUAL((intptr_t)frames, TOTAL);
    ring_free(&ring);
}

int main(void) {
    test_full();
    test_cuts();
    test_two_threads();
    return 0;
}
