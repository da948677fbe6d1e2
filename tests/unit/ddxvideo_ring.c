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

static void test_full(void) {
    struct ring ring;
    unsigned char frame[100] = {0};
    const unsigned char *bytes;
    struct ring_frame out;
    const struct iovec piece = {frame, sizeof(frame)};
    CHECK(!ring_init(&ring, 4, sizeof(frame)));
    CHECK(ring_put_bytes(&ring, "header", 6));
    for (int64_t i = 0; i < 4; i++)
        CHECK(ring_put(&ring, &piece, 1, i));
    CHECK(!ring_put(&ring, &piece, 1, 4)); /* bytes would fit, the number of frames is the limit */
    CHECK_EQUAL(ring_peek(&ring, &bytes, 1000), 406);
    CHECK(!memcmp(bytes, "header", 6));
    ring_take(&ring, 105);
    CHECK(!ring_next_frame(&ring, &out)); /* its last byte is still there */
    CHECK(!ring_put(&ring, &piece, 1, 4));
    ring_take(&ring, 1);
    CHECK(ring_next_frame(&ring, &out));
    CHECK_EQUAL(out.stamp, 0);
    CHECK_EQUAL(out.end, 106);
    CHECK(!ring_next_frame(&ring, &out));
    CHECK(ring_put(&ring, &piece, 1, 4));
    ring_close(&ring);
    CHECK_EQUAL(ring_peek(&ring, &bytes, 1000), 400);
    ring_take(&ring, 400);
    for (int64_t i = 1; i <= 4; i++) {
        CHECK(ring_next_frame(&ring, &out));
        CHECK_EQUAL(out.stamp, i);
    }
    CHECK_EQUAL(ring_peek(&ring, &bytes, 1000), 0);
    ring_free(&ring);
    CHECK(ring_init(&ring, 1000000, SIZE_MAX / 100) == -ENOMEM);
}

static void *drain(void *argument) {
    struct ring *ring = argument;
    const unsigned char *bytes;
    uint64_t position = 0;
    int64_t frames = 0;
    size_t size;
    while ((size = ring_peek(ring, &bytes, 1 << 20))) {
        size -= size / 3; /* a disk that takes less than it is given */
        for (size_t i = 0; i < size; i += 997)
            if (bytes[i] != byte_of(position + i)) {
                fprintf(stderr, "byte %" PRIu64 " is wrong\n", position + i);
                exit(1);
            }
        position += size;
        ring_take(ring, size);
        struct ring_frame frame;
        while (ring_next_frame(ring, &frame)) {
            CHECK(frame.end <= position);
            CHECK_EQUAL(frame.stamp, frames);
            frames++;
        }
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
    for (int64_t i = 0; i < TOTAL; i++) {
        size_t size = 1 + (size_t)(i * 7919 % FRAME_BYTES);
        fill(frame, position, size);
        const struct iovec pieces[2] = {{frame, size / 2}, {frame + size / 2, size - size / 2}};
        while (!ring_put(&ring, pieces, 2, i))
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
    test_two_threads();
    return 0;
}
