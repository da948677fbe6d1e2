/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Datagrams to frames: order, loss, duplicates, other sources; the counters match what was done to the packets. */
#include "stream_rx.h"

#include "check.h"

#define MS INT64_C(1000000)
#define PATIENCE (20 * MS)
#define SSRC 0x1001u
#define CAPTURE (INT64_C(1750000000) * 1000 * MS) /* of frame 0 */

static unsigned seed = 1;
static int64_t now = MS;

static unsigned next_random(unsigned below) {
    seed = seed * 1664525u + 1013904223u;
    return (seed >> 8) % below;
}

/* A sender: a frame is `packets` NAL units, one in each packet, with the numbers of frame and packet. */
struct source {
    uint32_t ssrc;
    uint16_t sequence;
    uint16_t count;
    uint8_t window; /* frames that repair packets reach back */
    bool plain;     /* no extension */
};

struct datagram {
    uint8_t data[100];
    size_t size;
};

static struct datagram make(struct source *source, uint32_t frame, unsigned index, unsigned packets) {
    struct datagram datagram;
    struct rtp_packet packet = {.type = RTP_H264,
                                .marker = index + 1 == packets,
                                .sequence = source->sequence++,
                                .time = frame * 3600,
                                .ssrc = source->ssrc,
                                .has_count = !source->plain,
                                .has_source = !source->plain && !index,
                                .frame = {.count = source->count,
                                          .window = source->window,
                                          .capture = CAPTURE + frame * 40 * MS,
                                          .sequence = frame + 1,
                                          .number = frame}};
    source->count += packet.marker;
    datagram.size = rtp_write(datagram.data, &packet);
    const uint8_t nal[] = {0x41, (uint8_t)(1 + frame % 200), (uint8_t)(1 + index)};
    memcpy(datagram.data + datagram.size, nal, sizeof(nal));
    datagram.size += sizeof(nal);
    return datagram;
}

static void put(struct stream_rx *rx, const struct datagram *datagram) {
    uint8_t *copy = malloc(datagram->size); /* so that a sanitizer sees a read beyond it */
    memcpy(copy, datagram->data, datagram->size);
    stream_rx_put(rx, copy, datagram->size, now);
    free(copy);
}

static void begin_rx(struct stream_rx *rx, bool repairs) {
    stream_rx_init(rx, &(struct stream_rx_settings){PATIENCE, repairs, true, 77});
}

static uint64_t count_of(const struct stream_rx *rx, enum stream_rx_count which) {
    return rx->count[which];
}

/* Sends frames of one packet in an order given by their numbers; returns the frames that come out, as a text. */
static const char *play(struct stream_rx *rx, struct source *source, const char *order) {
    static char out[200];
    struct datagram datagrams[26];
    struct assembly_frame frame;
    *out = 0;
    for (unsigned i = 0; i < 26; i++)
        datagrams[i] = make(source, i, 0, 1);
    for (; *order; order++) {
        if (*order == ' ') /* time passes */
            now += PATIENCE;
        else if (*order != '.')
            put(rx, &datagrams[*order - 'a']);
        while (*order == '.' ? stream_rx_take_last(rx, &frame) : stream_rx_take(rx, now, &frame)) {
            char one[8];
            snprintf(one, sizeof(one), "%s%c", frame.damaged ? "!" : "", (char)('a' + frame.frame.number));
            strcat(out, one);
            for (unsigned i = 0; i < frame.missing; i++)
                strcat(out, "-");
        }
        now += MS / 10;
    }
    return out;
}

static void check_order(const char *order, const char *expected, unsigned lost, unsigned late, unsigned duplicate,
                        unsigned reordered) {
    for (int wrap = 0; wrap < 2; wrap++) { /* also across a wrap of the sequence numbers */
        struct stream_rx rx;
        struct source source = {.ssrc = SSRC, .sequence = wrap ? 65533 : 100, .count = wrap ? 65530 : 0};
        begin_rx(&rx, true);
        const char *found = play(&rx, &source, order);
        if (strcmp(found, expected))
            fprintf(stderr, "%s gives %s, not %s\n", order, found, expected);
        CHECK(!strcmp(found, expected));
        CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST), lost);
        CHECK_EQUAL(count_of(&rx, STREAM_RX_LATE), late);
        CHECK_EQUAL(count_of(&rx, STREAM_RX_DUPLICATE), duplicate);
        CHECK_EQUAL(count_of(&rx, STREAM_RX_REORDERED), reordered);
        CHECK_EQUAL(count_of(&rx, STREAM_RX_RECEIVED),
                    count_of(&rx, STREAM_RX_USED) + late + duplicate + rx.reorder.waiting);
        stream_rx_free(&rx);
    }
}

/* "!": packets are missing in or before this frame; "-": a whole frame is missing before it; ".": no more will come. */
static void test_order(void) {
    check_order("abcdef", "abcdef", 0, 0, 0, 0);
    check_order("abdcef", "abcdef", 0, 0, 0, 1);
    check_order("afedcbg", "abcdefg", 0, 0, 0, 4);
    check_order("abbbacdc", "abcd", 0, 0, 4, 0);
    check_order("abddcc", "abcd", 0, 0, 2, 1);
    check_order("abde", "ab", 0, 0, 0, 0); /* c may still come */
    check_order("abde ", "ab!d-e", 1, 0, 0, 0);
    check_order("abde.", "ab!d-e", 1, 0, 0, 0);
    check_order("abdf.", "ab!d-!f-", 2, 0, 0, 0);
    check_order("abde cfg", "ab!d-efg", 1, 1, 0, 0); /* too late */
    check_order("abfg h", "ab!f---gh", 3, 0, 0, 0);
    check_order("acbd", "abcd", 0, 0, 0, 1);
    check_order("bacd", "bcd", 0, 1, 0, 0); /* frames before the first one are unknown */
    check_order("ac ce e", "a!c-!e-", 2, 0, 2, 0);
}

/* Frames of several packets: a missing packet marks its own frame, and the next one if it was the last packet. */
static void test_frames(void) {
    for (unsigned missing = 0; missing < 12; missing++) {
        struct stream_rx rx;
        struct source source = {.ssrc = SSRC};
        struct assembly_frame frame;
        unsigned found = 0, damaged = 0, incomplete = 0, bytes = 0;
        begin_rx(&rx, true);
        for (unsigned i = 0; i < 12; i++) {
            struct datagram datagram = make(&source, i / 4, i % 4, 4);
            if (i != missing)
                put(&rx, &datagram);
            now += 2 * PATIENCE;
            while (stream_rx_take(&rx, now, &frame)) {
                CHECK_EQUAL(frame.frame.number, found);
                CHECK_EQUAL(frame.frame.sequence, frame.has_source ? found + 1 : 0);
                CHECK_EQUAL(frame.missing, 0);
                CHECK(frame.first == !found);
                CHECK(frame.has_count && frame.has_source == (missing != 0 || found > 0));
                CHECK(frame.derived == (missing == 4 * found && found > 0));
                found++;
                damaged += frame.damaged;
                incomplete += frame.incomplete;
                bytes += (unsigned)frame.size;
            }
        }
        CHECK_EQUAL(found, missing == 11 ? 2 : 3); /* the last frame may be incomplete */
        while (stream_rx_take_last(&rx, &frame)) { /* until the end */
            CHECK_EQUAL(frame.frame.number, found);
            found++;
            damaged += frame.damaged;
            incomplete += frame.incomplete;
            bytes += (unsigned)frame.size;
        }
        CHECK_EQUAL(found, 3);
        CHECK(damaged >= 1);
        CHECK_EQUAL(incomplete, 1);
        CHECK_EQUAL(bytes, 11 * 7);
        stream_rx_free(&rx);
    }
}

/* A frame whose first packet is missing has facts derived from an earlier one, and is marked so. */
static void test_derived(void) {
    struct stream_rx rx;
    struct source source = {.ssrc = SSRC, .count = 65534};
    struct assembly_frame frame;
    begin_rx(&rx, true);
    for (uint32_t i = 10; i < 20; i++) {
        for (unsigned index = 0; index < 2; index++) {
            struct datagram datagram = make(&source, i, index, 2);
            bool lost = (index == 0 && (i < 13 || i % 3 == 0)) || i == 16; /* 16: all of it */
            if (!lost)
                put(&rx, &datagram);
            now += MS;
        }
        bool found = stream_rx_take(&rx, now += PATIENCE, &frame);
        CHECK(found == (i != 16));
        if (!found)
            continue;
        CHECK_EQUAL(frame.frame.count, (uint16_t)(65534 + i - 10));
        CHECK_EQUAL(frame.missing, i == 17);
        CHECK(frame.has_count && frame.has_source == (i >= 13));
        CHECK(frame.derived == (i >= 13 && i % 3 == 0));
        if (!frame.has_source)
            continue;
        CHECK_EQUAL(frame.frame.number, i);
        CHECK_EQUAL(frame.frame.sequence, i + 1);
        CHECK_EQUAL(frame.frame.capture, CAPTURE + i * 40 * MS);
    }
    CHECK(!stream_rx_take_last(&rx, &frame));
    stream_rx_free(&rx);
}

/* A seeded relay: the counters match its actions. */
static void test_counts(void) {
    enum { PACKETS = 20000, QUEUE = 16 };
    struct stream_rx rx;
    struct source source = {.ssrc = SSRC, .sequence = 60000}, foreign = {.ssrc = 0x2002};
    struct datagram queue[QUEUE];
    unsigned waiting = 0, dropped = 0, duplicated = 0, strangers = 0, garbage = 0, frames = 0, missing = 0;
    struct assembly_frame frame;
    begin_rx(&rx, true);
    for (unsigned i = 0; i < PACKETS; i++, now += 3 * MS) {
        struct datagram datagram = make(&source, i / 2, i % 2, 2);
        bool quiet = i < 2 || i >= PACKETS - 100; /* a loss at the very end is not noticed */
        if (!quiet && next_random(100) < 20) {
            dropped++;
        } else if (!quiet && waiting < 3 && next_random(100) < 10) {
            queue[waiting++] = datagram; /* up to three later ones overtake it */
            continue;
        } else {
            put(&rx, &datagram);
            if (!quiet && next_random(100) < 10) {
                put(&rx, &datagram);
                duplicated++;
            }
        }
        if (next_random(100) < 5) {
            datagram = make(&foreign, i, 0, 1);
            put(&rx, &datagram);
            foreign.sequence += 7; /* no two that follow each other */
            strangers++;
        }
        if (next_random(100) < 5) {
            datagram.data[0] = (uint8_t)next_random(128); /* not version 2 */
            put(&rx, &datagram);
            garbage++;
        }
        if (waiting == 3 || (waiting && (quiet || next_random(2))))
            put(&rx, &queue[--waiting]);
        while (stream_rx_take(&rx, now, &frame)) {
            frames++;
            missing += frame.missing;
        }
    }
    CHECK(dropped > 3000 && duplicated > 1000 && strangers > 500 && garbage > 500);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_GARBAGE), garbage);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_FOREIGN), strangers);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_DUPLICATE), duplicated);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST) - count_of(&rx, STREAM_RX_LATE), dropped);
    CHECK(count_of(&rx, STREAM_RX_REORDERED) > 500);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_USED), PACKETS - count_of(&rx, STREAM_RX_LOST));
    CHECK_EQUAL(frames + missing, PACKETS / 2);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_SOURCES), 1);
    stream_rx_free(&rx);
}

static unsigned send(struct stream_rx *rx, struct source *source, uint32_t frame) {
    struct datagram datagram = make(source, frame, 0, 1);
    struct assembly_frame out;
    unsigned found = 0;
    put(rx, &datagram);
    while (stream_rx_take(rx, now, &out))
        found++;
    return found;
}

/* A restarted sender is followed from its first frame on; a second stream beside the present one never is. */
static void test_sources(void) {
    struct stream_rx rx;
    struct source one = {.ssrc = SSRC, .sequence = 7}, two = {.ssrc = 0x2002, .sequence = 9000}, three = {.ssrc = 3};
    begin_rx(&rx, true);
    for (uint32_t i = 0; i < 100; i++, now += 40 * MS) {
        CHECK_EQUAL(send(&rx, &one, i), 1);
        CHECK_EQUAL(send(&rx, &two, i), 0);
    }
    CHECK_EQUAL(rx.ssrc, SSRC);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_FOREIGN), 100);
    now += STREAM_RX_SILENCE_NS; /* the first one is silent */
    CHECK_EQUAL(send(&rx, &three, 0), 0);
    now += MS;
    CHECK_EQUAL(send(&rx, &three, 1), 2); /* with its first frame */
    CHECK_EQUAL(rx.ssrc, 3);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_SOURCES), 2);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_FOREIGN), 100);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST), 0);
    CHECK_EQUAL(send(&rx, &one, 100), 0);
    stream_rx_free(&rx);

    /* A single stray packet at the start does not block the stream. */
    begin_rx(&rx, true);
    one = (struct source){.ssrc = SSRC};
    CHECK_EQUAL(send(&rx, &two, 0), 1);
    CHECK_EQUAL(send(&rx, &one, 0), 0);
    CHECK_EQUAL(send(&rx, &one, 1), 2);
    CHECK_EQUAL(send(&rx, &one, 2), 1);
    stream_rx_free(&rx);
}

/* A sender that restarts at once: all its frames are shown, once its former source counts as silent. */
static void test_quick_restart(void) {
    struct stream_rx rx;
    struct source one = {.ssrc = SSRC}, two = {.ssrc = 0x2002, .sequence = 65530}, stray = {.ssrc = 3};
    unsigned found = 0;
    begin_rx(&rx, true);
    for (uint32_t i = 0; i < 5; i++, now += 40 * MS)
        found += send(&rx, &one, i);
    for (uint32_t i = 0; i < 20; i++, now += 40 * MS) {
        found += send(&rx, &two, i);
        CHECK(found == 5 || i >= 9);
        if (i % 3 == 1) {
            CHECK_EQUAL(send(&rx, &stray, i), 0);
            stray.ssrc++;
        }
    }
    CHECK_EQUAL(found, 5 + 20);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST), 0);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_FOREIGN), 7);
    /* A source that appeared and died does not block the next one. */
    now += STREAM_RX_SILENCE_NS / 2;
    found = send(&rx, &stray, 1);
    found += send(&rx, &stray, 2);
    now += 2 * STREAM_RX_SILENCE_NS;
    for (uint32_t i = 0; i < 3; i++)
        found += send(&rx, &one, i);
    CHECK_EQUAL(found, 3);
    CHECK_EQUAL(rx.ssrc, SSRC);
    stream_rx_free(&rx);
}

/* Numbers from far away: one is a stray packet, two are a new place in the count. */
static void test_jumps(void) {
    static const int jumps[] = {500, 5000, -5000, 30000, -30000};
    for (unsigned i = 0; i < sizeof(jumps) / sizeof(*jumps); i++) {
        struct stream_rx rx;
        struct source source = {.ssrc = SSRC, .sequence = 20000};
        begin_rx(&rx, true);
        for (uint32_t frame = 0; frame < 10; frame++)
            CHECK_EQUAL(send(&rx, &source, frame), 1);
        source.sequence = (uint16_t)(source.sequence + jumps[i]);
        unsigned found = 0;
        for (uint32_t frame = 10; frame < 20; frame++)
            found += send(&rx, &source, frame);
        CHECK(found >= 9);
        if (jumps[i] > 0)
            CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST) - count_of(&rx, STREAM_RX_LATE), jumps[i]);
        stream_rx_free(&rx);
    }
}

/* One packet with our source's SSRC and a number from far away changes nothing. */
static void test_stray(void) {
    struct stream_rx rx;
    struct source source = {.ssrc = SSRC, .sequence = 20000}, stray = {.ssrc = SSRC, .sequence = 40000};
    begin_rx(&rx, true);
    for (uint32_t frame = 0; frame < 20; frame++) {
        CHECK_EQUAL(send(&rx, &source, frame), 1);
        if (frame % 5 == 0) {
            CHECK_EQUAL(send(&rx, &stray, 7), 0);
            stray.sequence += 3000;
        }
    }
    CHECK_EQUAL(count_of(&rx, STREAM_RX_LOST), 0);
    CHECK_EQUAL(count_of(&rx, STREAM_RX_LATE), 4);
    stream_rx_free(&rx);
}

/* Other senders do not number frames. */
static void test_plain(void) {
    struct stream_rx rx;
    struct source source = {.ssrc = SSRC, .plain = true};
    begin_rx(&rx, true);
    for (uint32_t i = 0; i < 10; i++)
        CHECK_EQUAL(send(&rx, &source, i), 1);
    stream_rx_free(&rx);
}

/* ---- Repair ---- */

#define WINDOW 25

/* A sender that repairs, and its receiver. Frames must come out whole and in order, without a gap. */
struct pair {
    struct source source;
    struct repair_window window;
    uint32_t esi; /* of the next packet */
    uint32_t frame;
    struct stream_rx rx;
    unsigned came, damaged, incomplete, missing;
};

static void begin_source(struct pair *pair, uint32_t ssrc, uint16_t sequence) {
    pair->source = (struct source){.ssrc = ssrc, .sequence = sequence, .count = 65530, .window = WINDOW};
    pair->esi = sequence;
    pair->frame = 0;
    repair_window_init(&pair->window, ssrc, ssrc + 1, 65530);
}

static struct pair *new_pair(uint16_t sequence, bool repairs) {
    struct pair *pair = calloc(1, sizeof(*pair));
    begin_source(pair, SSRC, sequence);
    begin_rx(&pair->rx, repairs);
    return pair;
}

static void take(struct pair *pair) {
    struct assembly_frame frame;
    while (stream_rx_take(&pair->rx, now, &frame)) {
        pair->came++;
        pair->damaged += frame.damaged;
        pair->incomplete += frame.incomplete;
        pair->missing += frame.missing;
    }
}

/* A frame; `lost`: bit n for its packet n. */
static void send_frame(struct pair *pair, unsigned packets, unsigned lost) {
    for (unsigned i = 0; i < packets; i++) {
        struct datagram datagram = make(&pair->source, pair->frame, i, packets);
        CHECK_EQUAL(repair_window_add(&pair->window, pair->esi++, pair->source.count, datagram.data, datagram.size), 0);
        if (!(lost >> i & 1))
            put(&pair->rx, &datagram);
        take(pair);
    }
    pair->frame++;
    now += 40 * MS;
}

static void send_repair(struct pair *pair) {
    uint8_t data[REPAIR_MAX];
    size_t size = repair_make(&pair->window, pair->esi - REPAIR_PACKETS, data);
    uint8_t *copy = malloc(size);
    memcpy(copy, data, size);
    stream_rx_put_repair(&pair->rx, copy, size, now);
    free(copy);
    take(pair);
}

static unsigned wanted(const struct pair *pair) {
    unsigned missing;
    uint16_t base, highest;
    CHECK(restore_missing(&pair->rx.restore, &missing, &base, &highest));
    return missing;
}

static void check_sums(const struct pair *pair) {
    const struct stream_rx *rx = &pair->rx;
    CHECK_EQUAL(count_of(rx, STREAM_RX_RECEIVED) + count_of(rx, STREAM_RX_RESTORED),
                count_of(rx, STREAM_RX_USED) + count_of(rx, STREAM_RX_LATE) + count_of(rx, STREAM_RX_DUPLICATE) +
                    count_of(rx, STREAM_RX_FOREIGN) + count_of(rx, STREAM_RX_GARBAGE) + rx->reorder.waiting);
    CHECK_EQUAL(count_of(rx, STREAM_RX_REPAIR_RECEIVED),
                count_of(rx, STREAM_RX_RESTORED) + count_of(rx, STREAM_RX_REPAIR_REFUSED) +
                    count_of(rx, STREAM_RX_REPAIR_USELESS) + count_of(rx, STREAM_RX_REPAIR_EXPIRED) +
                    count_of(rx, STREAM_RX_REPAIR_CORRUPT) + rx->restore.rows);
}

static void end_pair(struct pair *pair) {
    check_sums(pair);
    stream_rx_free(&pair->rx);
    free(pair);
}

/* The receiver waits for missing packets longer than the reordering time; then all waiting frames come at once. */
static void test_restored(void) {
    for (unsigned wrap = 0; wrap < 2; wrap++) {
        struct pair *pair = new_pair(wrap ? 65530 : 100, true);
        for (unsigned i = 0; i < 3; i++) {
            send_frame(pair, 2, 0);
            CHECK_EQUAL(pair->came, i + 1);
        }
        struct source again = pair->source;
        struct datagram late = make(&again, 3, 0, 2);
        send_frame(pair, 2, 1);
        for (unsigned i = 0; i < 5; i++)
            send_frame(pair, 2, i == 2 ? 3 : 0);
        CHECK_EQUAL(pair->came, 3);
        CHECK_EQUAL(wanted(pair), 3);
        for (unsigned i = 0; i < 3; i++) {
            CHECK_EQUAL(pair->came, 3);
            send_repair(pair);
        }
        CHECK_EQUAL(pair->came, 9);
        CHECK_EQUAL(wanted(pair), 0);
        CHECK_EQUAL(pair->damaged + pair->missing, 0);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_RESTORED), 3);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_LOST) + count_of(&pair->rx, STREAM_RX_REORDERED), 0);
        put(&pair->rx, &late);
        take(pair);
        send_repair(pair);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_DUPLICATE), 1);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_USELESS), 1);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_WRONG), 0);
        send_frame(pair, 2, 0);
        CHECK_EQUAL(pair->came, 10);
        end_pair(pair);
    }
}

/* The last packets of a stream: only repair packets show that they are missing. */
static void test_restored_end(void) {
    struct pair *pair = new_pair(7, true);
    send_frame(pair, 3, 0);
    send_frame(pair, 3, 6);
    send_frame(pair, 1, 1);
    CHECK_EQUAL(wanted(pair), 0);
    send_repair(pair);
    CHECK_EQUAL(wanted(pair), 2);
    send_repair(pair);
    send_repair(pair);
    CHECK_EQUAL(pair->came, 3);
    CHECK_EQUAL(pair->damaged + pair->missing, 0);
    end_pair(pair);
}

/* Number of frames sent after a missing one until it is given up. */
static unsigned frames_until_given_up(struct pair *pair, unsigned packets, int64_t interval, unsigned most) {
    unsigned frames = 0;
    send_frame(pair, packets, 0);
    send_frame(pair, packets, (1u << packets) - 1);
    for (; pair->came == 1 && frames < most; frames++, now += interval - 40 * MS)
        send_frame(pair, packets, 0);
    CHECK_EQUAL(pair->missing, pair->came > 1);
    CHECK_EQUAL(pair->came, pair->came > 1 ? frames + 1 : 1);
    CHECK_EQUAL(pair->damaged, pair->came > 1); /* the first one after the gap, */
    CHECK_EQUAL(pair->incomplete, 0);           /* which is whole */
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_LOST), pair->came > 1 ? packets : 0);
    return frames;
}

/* A gap is given up when the sender's window has passed it, when the receiver's places are used up, or after 1 s. */
static void test_give_up(void) {
    static const struct {
        unsigned packets;
        int64_t interval;
        unsigned frames;
    } cases[] = {{2, 20 * MS, WINDOW + 1}, {12, 40 * MS, 256 / 12 + 1}, {1, 300 * MS, 5}, {1, 200 * MS, 6}};
    for (unsigned i = 0; i < sizeof(cases) / sizeof(*cases); i++) {
        struct pair *pair = new_pair(65500, true);
        CHECK_EQUAL(frames_until_given_up(pair, cases[i].packets, cases[i].interval, 100), cases[i].frames);
        CHECK_EQUAL(wanted(pair), 0); /* no report asks for it */
        send_repair(pair);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_RECEIVED), 1);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_RESTORED), 0);
        end_pair(pair);
    }
    /* Between frames, the deadline gives the next time to check. */
    struct pair *pair = new_pair(1, true);
    send_frame(pair, 1, 0);
    send_frame(pair, 1, 1);
    int64_t since = now;
    send_frame(pair, 1, 0);
    CHECK_EQUAL(stream_rx_deadline(&pair->rx), since + STREAM_RX_REPAIR_NS);
    now = since + STREAM_RX_REPAIR_NS;
    take(pair);
    CHECK_EQUAL(pair->came, 2);
    CHECK_EQUAL(stream_rx_deadline(&pair->rx), INT64_MAX);
    end_pair(pair);
}

/* A repair packet about packets so new that the window cannot hold the packets that wait as well: first the gap before
 * those is given up, and they go out. */
static void test_repair_ahead(void) {
    struct pair *pair = new_pair(65300, true);
    pair->source.window = 127;
    send_frame(pair, 1, 0);
    send_frame(pair, 1, 1);
    for (unsigned i = 0; i < 20; i++)
        send_frame(pair, 12, 0);
    CHECK_EQUAL(pair->came, 1);
    send_frame(pair, 12, 0xfff);
    send_frame(pair, 12, 0xfff);
    CHECK_EQUAL(pair->came, 1);
    send_repair(pair);
    CHECK_EQUAL(pair->came, 21);
    CHECK_EQUAL(pair->missing, 1);
    CHECK_EQUAL(pair->incomplete, 0);
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_LOST), 1);
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_RECEIVED), 1);
    CHECK_EQUAL(pair->rx.restore.rows, 1);
    CHECK_EQUAL(wanted(pair), 23);
    end_pair(pair);
}

/* A receiver that shows damaged frames at once, and a sender without repair: only the patience counts. */
static void test_patience(void) {
    for (unsigned plain = 0; plain < 2; plain++) {
        struct pair *pair = new_pair(1, plain);
        pair->source.window = plain ? 0 : WINDOW;
        send_frame(pair, 2, 0);
        send_frame(pair, 2, 1);
        take(pair);
        CHECK_EQUAL(pair->came, 2);
        CHECK_EQUAL(pair->incomplete, 1);
        send_repair(pair);
        CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_EXPIRED), 1);
        end_pair(pair);
    }
}

/* At 30 % loss of all packets, when as many repair packets are sent as are needed, no frame is lost or damaged. */
static void test_seeded_loss(void) {
    struct pair *pair = new_pair(60000, true);
    unsigned lost = 0;
    for (unsigned i = 0; i < 4000; i++) {
        unsigned packets = 1 + next_random(3), mask = 0;
        for (unsigned bit = 0; i > 0 && bit < packets; bit++)
            mask |= (unsigned)(next_random(10) < 3) << bit;
        lost += (unsigned)__builtin_popcount(mask);
        send_frame(pair, packets, mask);
        for (unsigned n = wanted(pair); n; n--)
            if (next_random(10) >= 3)
                send_repair(pair);
        if (i % 100 == 99)
            check_sums(pair);
    }
    send_frame(pair, 1, 0);
    while (wanted(pair))
        send_repair(pair);
    CHECK(lost > 2000);
    CHECK_EQUAL(pair->came, 4001);
    CHECK_EQUAL(pair->damaged + pair->missing, 0);
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_RESTORED), lost);
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_LOST), 0);
    end_pair(pair);
}

/* A sender that restarts while a packet of its former source is missing: repair packets count for their source only. */
static void test_repair_of_sources(void) {
    struct pair *pair = new_pair(5, true);
    send_frame(pair, 2, 0);
    send_frame(pair, 2, 1);
    send_frame(pair, 2, 0);
    send_frame(pair, 2, 1);
    send_repair(pair); /* two are missing: it waits */
    struct repair_window former = pair->window;
    begin_source(pair, 0x2002, 9000);
    for (unsigned i = 0; i < 11; i++)
        send_frame(pair, 2, i == 5);
    CHECK_EQUAL(pair->rx.ssrc, 0x2002);
    CHECK_EQUAL(pair->came, 4 + 5); /* all frames of the former source, and the new one's up to the gap */
    CHECK_EQUAL(pair->incomplete, 2);
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_EXPIRED), 1);
    send_repair(pair);
    CHECK_EQUAL(pair->came, 4 + 11);
    uint8_t data[REPAIR_MAX];
    CHECK(!stream_rx_put_repair(&pair->rx, data, repair_make(&former, 0, data), now));
    CHECK_EQUAL(count_of(&pair->rx, STREAM_RX_REPAIR_REFUSED), 1);
    end_pair(pair);
}

/* An invalid repair packet changes nothing. */
static void test_repair_garbage(void) {
    struct pair *pair = new_pair(5, true);
    uint8_t data[REPAIR_MAX];
    send_frame(pair, 2, 0);
    send_frame(pair, 2, 1);
    for (unsigned i = 0; i < 20000; i++) {
        size_t size = repair_make(&pair->window, 0, data);
        for (unsigned n = 1 + next_random(3); n && i % 2; n--)
            data[next_random(16)] = (uint8_t)next_random(256); /* its header */
        if (i % 2 == 0)
            memset(data, (int)next_random(256), size = next_random(sizeof(data)));
        stream_rx_put_repair(&pair->rx, data, size, now);
        take(pair);
        if (pair->rx.restore.rows || pair->came > 1)
            break; /* one in many thousands is a repair packet after all */
    }
    check_sums(pair);
    send_frame(pair, 2, 0);
    send_repair(pair);
    send_repair(pair);
    CHECK_EQUAL(pair->came, 3);
    end_pair(pair);
}

/* Reports are about the source that is followed. A source without our extension, and a silent receiver, get none. */
static void test_reports(void) {
    uint8_t data[REPORT_MAX];
    struct report report;

    for (unsigned kind = 0; kind < 3; kind++) { /* 1: another program's stream; 2: silent */
        static struct stream_rx rx;
        struct source source = {.ssrc = SSRC, .sequence = 100, .plain = kind == 1};

        begin_rx(&rx, true);
        rx.settings.reports = kind != 2;
        rx.report_header = 28;
        CHECK_EQUAL(stream_rx_report(&rx, now, false, data), 0);
        for (unsigned i = 0; i < 4; i++) {
            struct datagram datagram = make(&source, i, 0, 1);
            if (i != 2)
                put(&rx, &datagram);
        }
        CHECK_EQUAL(stream_rx_report_deadline(&rx), kind ? INT64_MAX : now);
        size_t size = stream_rx_report(&rx, now, true, data);
        CHECK_EQUAL(size, kind ? 0 : REPORT_MAX);
        stream_rx_free(&rx);
        if (kind)
            continue;
        CHECK(!report_parse(data, size, &report) && report.has_state && report.refresh);
        CHECK(report.reporter == 77 && report.media == SSRC && !report.has_repair);
        CHECK(report.highest == 103 && report.base == 102 && report.missing == 1);
        CHECK_EQUAL(stream_rx_report(&rx, now, true, data), 0);
        CHECK(stream_rx_report_deadline(&rx) > now);
    }
}

int main(void) {
    test_order();
    test_reports();
    test_frames();
    test_derived();
    test_counts();
    test_sources();
    test_quick_restart();
    test_jumps();
    test_stray();
    test_plain();
    test_restored();
    test_restored_end();
    test_give_up();
    test_repair_ahead();
    test_patience();
    test_seeded_loss();
    test_repair_of_sources();
    test_repair_garbage();
    return 0;
}
