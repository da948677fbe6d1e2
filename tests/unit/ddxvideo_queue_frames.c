/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The size of the recorder's queue: its memory is bounded for each picture size and rate. */
#include <unistd.h>

#include "check.h"
#include "frame_queue.h"
#include "recording.h"
#include "video_layout.h"
#include "y4m.h"

static struct ddxvideo_geometry geometry_of(int width, int height, int num, int den) {
    return (struct ddxvideo_geometry){.width = width, .height = height, .fields = 1, .rate_num = num, .rate_den = den};
}

static void test_usual(void) {
    static const struct {
        int num, den;
        unsigned frames;
    } table[] = {{0, 0, 64}, {25, 1, 64}, {1, 100, 64}, {60, 1, 150}, {60000, 1001, 150}, {10000, 1, 25000}};
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        const struct ddxvideo_geometry geometry = geometry_of(64, 48, table[i].num, table[i].den);
        CHECK_EQUAL(recording_queue_frames(&geometry, 0), table[i].frames);
    }
    const struct ddxvideo_geometry geometry = geometry_of(64, 48, 25, 1);
    CHECK_EQUAL(recording_queue_frames(&geometry, 2), 2);
    CHECK_EQUAL(recording_queue_frames(&geometry, 1000), 1000);
}

/* Memory of the real queue, not the computed size. */
static uint64_t memory_of(const struct ddxvideo_geometry *geometry, unsigned frames) {
    struct frame_queue queue;
    size_t bytes = video_layout_bytes(geometry) + Y4M_FRAME_LINE_WRITTEN;
    CHECK(!frame_queue_init(&queue, frames, bytes));
    queue.enough = true; /* so that the populator does not touch its memory */
    uint64_t memory = queue.size + frames * sizeof(*queue.frames);
    frame_queue_free(&queue);
    return memory;
}

static void test_bounds(void) {
    static const int sides[] = {2, 4, 16, 64, 352, 1920};
    static const int rates[] = {0, 1, 25, 1000, 10000, 10001, 3000000, INT32_MAX};
    const uint64_t share = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / 4;
    const uint64_t slack = 1 << 20; /* whole megabytes are mapped */
    for (size_t s = 0; s < sizeof(sides) / sizeof(*sides); s++) {
        for (size_t r = 0; r < sizeof(rates) / sizeof(*rates); r++) {
            const struct ddxvideo_geometry geometry = geometry_of(sides[s], sides[s], rates[r], rates[r] != 0);
            unsigned frames = recording_queue_frames(&geometry, 0);
            CHECK(frames >= 8 && frames <= 25000);
            CHECK(memory_of(&geometry, frames) <= recording_queue_bytes_max() + slack);
            frames = recording_queue_frames(&geometry, 100000);
            CHECK(frames >= 8 && memory_of(&geometry, frames) <= share + slack);
        }
    }
    CHECK(recording_queue_bytes_max() <= UINT64_C(256) << 20);
}

int main(void) {
    test_usual();
    test_bounds();
    return 0;
}
