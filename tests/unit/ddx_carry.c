/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The store copies the last frame of a writer that it gave up into the next epoch, while that writer still writes: the
 * copy is whole, and has the right number.
 */
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "../../package/ddx/store/epoch.h"
#include "../../package/ddx/store/holder.h"
#include "../../package/ddx/store/checkpoint.h"
#include "check.h"

#define SLOTS 3u
#define WORDS 250000u
#define TURNS 80
#define BROKEN_TURNS 8000 /* with the defect a few percent are torn, and sometimes none of 80 */
#define STEP 16u /* words between those that change from frame to frame: every cache line, or every other one */

/* Replaces the holder's function. */
void holder_beat(void) {}

static struct epoch *from;
static atomic_bool over;

static struct epoch *new_epoch(uint32_t number, unsigned slots) {
    struct ddx_layout *layout = ddx_layout_opaque(WORDS * sizeof(uint64_t));
    struct epoch *epoch = epoch_new(layout, number);

    CHECK(epoch);
    free(layout);
    CHECK_EQUAL(epoch_create_control(epoch, "carry"), 0);
    CHECK_EQUAL(epoch_add_slots(epoch, "carry", slots), 0);
    return epoch;
}

/* Writes in bursts, so that the store sometimes finds the writer idle. */
static void *write_on(void *unused) {
    struct ddx_notice notice = {0};
    struct ddx_ring_writer writer = {
        .control = from->control, .notice = &notice, .epoch = 1, .slot_count = SLOTS, .told_count = SLOTS};
    uint64_t *data[SLOTS];

    for (unsigned i = 0; i < SLOTS; i++) {
        writer.slot[i] = (uint8_t)i;
        data[i] = ddx_memory_map(from->slot_fd[i], WORDS * sizeof(uint64_t), true);
        CHECK(data[i]);
    }
    while (!atomic_load(&over)) {
        unsigned slot;

        CHECK_EQUAL(ddx_ring_choose(&writer, &slot), 0);
        for (unsigned i = 0; i < WORDS; i += STEP)
            data[slot][i] = writer.sequence + 1;
        ddx_ring_publish(&writer, slot, (int64_t)writer.sequence + 1);
        if (writer.sequence % 64 == 0)
            nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    return unused;
}

int main(void) {
    unsigned carried = 0, torn = 0;
    int turns = getenv("DDX_BROKEN") ? BROKEN_TURNS : TURNS;
    pthread_t writer;

    CHECK_EQUAL(checkpoint_begin(), 0);
    CHECK(!checkpoint_restore());
    from = new_epoch(1, SLOTS);
    atomic_store(&from->control->slots, SLOTS);
    CHECK_EQUAL(pthread_create(&writer, NULL, write_on, NULL), 0);
    for (int turn = 0; turn < turns && !torn; turn++) {
        struct epoch *to = new_epoch(2, 1);
        struct ddx_ring_frame frame;
        uint64_t sequence = 0;

        if (epoch_carry_over(from, to, &sequence)) {
            const uint64_t *data = ddx_memory_map(to->slot_fd[0], WORDS * sizeof(uint64_t), false);

            CHECK(data && ddx_ring_peek(to->control, &frame));
            CHECK_EQUAL(frame.sequence, sequence);
            carried++;
            for (unsigned i = 0; i < WORDS; i += STEP)
                if (data[i] != sequence) {
                    torn++;
                    break;
                }
            munmap((void *)(uintptr_t)data, WORDS * sizeof(uint64_t));
        }
        epoch_free(to);
    }
    atomic_store(&over, true);
    pthread_join(writer, NULL);
    epoch_free(from);
    printf("%u carried over, %u torn\n", carried, torn);
    CHECK(carried > 0);
    CHECK_NO_FRAMES(torn);
    return 0;
}
