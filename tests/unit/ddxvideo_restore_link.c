/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Seeded links that lose, repeat and delay packets: all lost packets are restored, and no others. */
#include "repair_stream.h"

#include "bits.h"

static struct stream stream;
static uint8_t packet[REPAIR_MAX];

static uint64_t count(enum restore_count which) {
    return stream.restore.count[which];
}

/* A link that loses, repeats and delays media and repair packets; up to 40 packets may overtake one. */
struct link {
    struct {
        uint8_t data[REPAIR_MAX];
        size_t size;
        bool repair;
        unsigned due;
    } queue[64];
    unsigned now;
};

static void deliver_due(struct link *link) {
    for (unsigned i = 0; i < 64; i++) {
        if (!link->queue[i].size || link->queue[i].due > link->now)
            continue;
        int result = stream_deliver(&stream, link->queue[i].data, link->queue[i].size, link->queue[i].repair);
        if (!result && !link->queue[i].repair)
            stream.has[get16(link->queue[i].data + 2)] = true;
        CHECK(result == 0 || result == -EALREADY);
        link->queue[i].size = 0;
        stream_take(&stream);
    }
    link->now++;
}

static void put(struct link *link, const uint8_t *data, size_t size, bool repair, unsigned loss) {
    unsigned copies = next_random(100) < loss ? 0 : next_random(100) < 5 ? 2 : 1;
    for (unsigned i = 0; i < 64 && copies; i++) {
        if (link->queue[i].size)
            continue;
        memcpy(link->queue[i].data, data, size);
        link->queue[i].size = size;
        link->queue[i].repair = repair;
        link->queue[i].due = link->now + (next_random(100) < 10 ? next_random(40) : 0);
        copies--;
    }
}

/* 600 frames of 1 to 4 packets; packets that are missing for 25 frames are given up. */
static void play(uint32_t first, unsigned loss, unsigned percent, bool reports) {
    struct link link = {.now = 0};
    uint32_t begins[600];
    unsigned owed = 0, found, lost = 0;
    uint16_t base, highest;
    stream_begin(&stream, first);
    for (unsigned frame = 0; frame < 600; frame++) {
        unsigned quiet = frame > 580;
        begins[frame] = stream.next;
        for (unsigned packets = 1 + next_random(4); packets; packets--, owed += percent) {
            struct media media = media_of(stream_send(&stream, (uint16_t)frame));
            put(&link, media.data, media.size, false, quiet ? 0 : loss);
            deliver_due(&link);
        }
        uint32_t from = frame < 24 ? first : begins[frame - 24];
        if (reports) { /* repair as many as are missing, from the first missing one on */
            CHECK(restore_missing(&stream.restore, &found, &base, &highest));
            from = stream.next - 1 - (uint16_t)((uint16_t)(stream.next - 1) - base);
            owed = found * 100;
        }
        for (; owed >= 100; owed -= 100) {
            size_t size = repair_make(&stream.window, from, packet);
            put(&link, packet, size, true, loss);
            deliver_due(&link);
        }
        if (frame >= 25)
            restore_give_up(&stream.restore, (uint16_t)begins[frame - 25]);
        if (frame % 8 == 0)
            check_rows(&stream.restore);
    }
    for (uint32_t esi = first; esi != begins[580]; esi++)
        lost += !stream.has[(uint16_t)esi];
    CHECK(stream.restored > (begins[580] - first) * loss / 150);
    CHECK_EQUAL(lost, 0);
    CHECK(count(RESTORE_REFUSED) == 0 && count(RESTORE_CORRUPT) == 0 && stream.restore.wrong == 0);
}

int main(void) {
    for (unsigned i = 0; i < 4; i++) {
        seed = 100 + i;
        play(65000 + i * 100000, 30, 120, false);
        play(65000 + i * 100000, 30, 0, true);
        play(65000 + i * 100000, 10, 60, false);
    }
    return 0;
}
