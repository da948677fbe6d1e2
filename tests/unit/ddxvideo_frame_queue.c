/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The recorder's queue: frames come out in order; a full queue refuses a frame and loses no other. */
#include <errno.h>
#include <unistd.h>

#include "check.h"
#include "frame_queue.h"

#define FRAMES 16
#define FRAME_BYTES 700001 /* neither fits the queue's size nor any alignment */
#define TOTAL 400

static unsigned char byte_of(uint64_t position) {
    return (unsigned char)(position * 2654435761u >> 24);
}

static void fill(unsigned char *bytes, uint64_t position, size_t size) {
    for (size_t i = 0; i < size; i++)
        bytes[i] = byte_of(position + i);
}

/* All bytes that are ready, at most `limit`; 0 at the end. */
static size_t peek(struct frame_queue *queue, const unsigned char **bytes, size_t limit) {
    size_t size = 0;
    return frame_queue_peek(queue, bytes, &size, limit) == FRAME_QUEUE_BYTES ? size : 0;
}

static void test_full(void) {
    struct frame_queue queue;
    unsigned char frame[100] = {0};
    const unsigned char *bytes;
    struct frame_queue_frame out;
    const struct iovec pieces[2] = {{(void *)(uintptr_t) "header", 6}, {frame, sizeof(frame)}};
    CHECK(!frame_queue_init(&queue, 4, sizeof(frame)));
    CHECK(frame_queue_put(&queue, pieces, 2, &(struct frame_queue_facts){.header = 6}));
    for (int i = 1; i < 4; i++)
        CHECK(frame_queue_put(&queue, pieces + 1, 1, &(struct frame_queue_facts){.frame = i}));
    CHECK(frame_queue_level(&queue) == 100);
    /* The bytes would fit, but the number of frames is limited. */
    CHECK(!frame_queue_put(&queue, pieces + 1, 1, &(struct frame_queue_facts){.frame = 4}));
    CHECK_EQUAL(peek(&queue, &bytes, 1000), 406);
    CHECK(!memcmp(bytes, "header", 6));
    CHECK(frame_queue_oldest(&queue, &out));
    CHECK_EQUAL(out.begin, 6);
    CHECK_EQUAL(out.end, 106);
    frame_queue_take(&queue, 406);
    for (int i = 0; i < 4; i++) {
        CHECK(frame_queue_oldest(&queue, &out));
        CHECK_EQUAL(out.facts.frame, i);
        CHECK_EQUAL(out.end, 106 + (unsigned)i * 100);
        frame_queue_drop_oldest(&queue);
    }
    CHECK(!frame_queue_oldest(&queue, &out));
    CHECK(frame_queue_put(&queue, pieces + 1, 1, &(struct frame_queue_facts){.frame = 4}));
    frame_queue_close(&queue);
    CHECK_EQUAL(peek(&queue, &bytes, 1000), 100);
    frame_queue_take(&queue, 100);
    CHECK_EQUAL(peek(&queue, &bytes, 1000), 0);
    frame_queue_free(&queue);
    CHECK(frame_queue_init(&queue, 1000000, SIZE_MAX / 100) == -ENOMEM);
}

/* Files begin at block boundaries; a partly consumed block is not overwritten. */
static void test_cuts(void) {
    struct frame_queue queue;
    static unsigned char frame[FRAME_QUEUE_BLOCK];
    const unsigned char *bytes, *before;
    size_t size;
    const struct iovec piece = {frame, 1000};
    CHECK(!frame_queue_init(&queue, 1000, 1000));
    memset(frame, 1, sizeof(frame));
    CHECK(frame_queue_put(&queue, &piece, 1, &(struct frame_queue_facts){0}));
    CHECK_EQUAL(peek(&queue, &before, 5000), 1000);
    frame_queue_take(&queue, 1000);
    memset(frame, 2, sizeof(frame));
    CHECK(frame_queue_put(&queue, &piece, 1, &(struct frame_queue_facts){0}));
    CHECK(frame_queue_cut(&queue));
    memset(frame, 3, sizeof(frame));
    CHECK(frame_queue_put(&queue, &piece, 1, &(struct frame_queue_facts){0}));
    CHECK_EQUAL(peek(&queue, &bytes, 5000), 1000);
    CHECK(bytes == before + 1000 && bytes[0] == 2 && before[0] == 1);
    frame_queue_take(&queue, 1000);
    CHECK(frame_queue_peek(&queue, &bytes, &size, 5000) == FRAME_QUEUE_CUT);
    CHECK_EQUAL(frame_queue_next_file(&queue), FRAME_QUEUE_BLOCK);
    CHECK_EQUAL(peek(&queue, &bytes, 5000), 1000);
    CHECK(bytes == before + FRAME_QUEUE_BLOCK && bytes[0] == 3 && !((uintptr_t)bytes % FRAME_QUEUE_BLOCK));
    for (int i = 0; i < FRAME_QUEUE_CUTS; i++)
        CHECK(frame_queue_cut(&queue));
    CHECK(!frame_queue_cut(&queue));
    frame_queue_free(&queue);
}

static void *drain(void *argument) {
    struct frame_queue *queue = argument;
    const unsigned char *bytes;
    uint64_t position = 0;
    int64_t frames = 0;
    size_t size;
    while ((size = peek(queue, &bytes, 1 << 20))) {
        size -= size / 3; /* a disk that accepts only a part */
        for (size_t i = 0; i < size; i += 997)
            if (bytes[i] != byte_of(position + i)) {
                fprintf(stderr, "byte %" PRIu64 " is wrong\n", position + i);
                exit(1);
            }
        position += size;
        frame_queue_take(queue, size);
        struct frame_queue_frame frame;
        for (; frame_queue_oldest(queue, &frame) && frame.end <= position; frame_queue_drop_oldest(queue), frames++)
            CHECK_EQUAL(frame.facts.frame, frames);
    }
    return (void *)(intptr_t)frames;
}

static void test_two_threads(void) {
    struct frame_queue queue;
    pthread_t thread;
    static unsigned char frame[FRAME_BYTES];
    void *frames;
    CHECK(!frame_queue_init(&queue, FRAMES, FRAME_BYTES));
    CHECK(!pthread_create(&thread, NULL, drain, &queue));
    uint64_t position = 0;
    for (int i = 0; i < TOTAL; i++) {
        size_t size = 1 + (size_t)i * 7919 % FRAME_BYTES;
        fill(frame, position, size);
        const struct iovec pieces[2] = {{frame, size / 2}, {frame + size / 2, size - size / 2}};
        while (!frame_queue_put(&queue, pieces, 2, &(struct frame_queue_facts){.frame = i}))
            usleep(100);
        position += size;
    }
    frame_queue_close(&queue);
    pthread_join(thread, &frames);
    CHECK_EQUAL((intptr_t)frames, TOTAL);
    frame_queue_free(&queue);
}

int main(void) {
    test_full();
    test_cuts();
    test_two_threads();
    return 0;
}
