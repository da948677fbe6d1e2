/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Bad packets: no wrong packet is restored, and the stream continues. */
#include "repair_stream.h"

#include "bits.h"
#include "gf256.h"

static struct stream stream;
static uint8_t packet[REPAIR_MAX];

static uint64_t count(enum restore_count which) {
    return stream.restore.count[which];
}

/* The stream still restores lost packets. */
static void check_alive(void) {
    unsigned before = stream.restored, found;
    uint16_t base, highest;
    stream_lose(&stream, 3, 3);
    uint32_t first = stream.next - 3;
    for (int i = 0; i < 4; i++)
        stream_repair(&stream, first);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, before + 2);
    CHECK(restore_missing(&stream.restore, &found, &base, &highest));
    CHECK_EQUAL(highest, (uint16_t)(stream.next - 1));
    check_rows(&stream.restore);
}

/* An impossible repair packet is refused and changes nothing. */
static void test_impossible(void) {
    static struct restore before;
    stream_begin(&stream, 65530);
    stream_lose(&stream, 8, 0x12);
    size_t size = repair_make(&stream.window, 65531, packet);
    uint32_t newest = stream.next - 1;
    const struct {
        unsigned at;
        uint32_t value;
    } bad[] = {
        {12, SSRC + 1},                  /* another stream */
        {12, REPAIR_SSRC},               /* itself */
        {20, newest + RESTORE_AHEAD},    /* ends too far ahead */
        {20, newest + 20000},            /* or anywhere */
        {20, newest - 20000},            /* */
        {20, newest - RESTORE_JUMP - 8}, /* */
        {16, 0xf000},                    /* covers nothing, */
        {16, 0xf101},                    /* more than allowed, */
        {16, 0xffff},                    /* */
        {16, 0xe008},                    /* or not everything */
    };
    restore_clear(&stream.restore); /* the copy reads all of it */
    before = stream.restore;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        uint8_t copy[REPAIR_MAX];
        memcpy(copy, packet, size);
        put32(copy + bad[i].at, bad[i].value);
        CHECK_EQUAL(stream_deliver(&stream, copy, size, true), -EBADMSG);
        before.count[RESTORE_RECEIVED] = before.count[RESTORE_REFUSED] = i + 1;
        CHECK(!memcmp(&before, &stream.restore, sizeof before));
    }
    size_t longest = 0; /* of the received packets: the sum cannot be shorter */
    for (uint32_t esi = 65531; esi <= newest; esi++)
        if (stream.has[(uint16_t)esi] && media_of(esi).size > longest)
            longest = media_of(esi).size;
    CHECK(longest > 200);
    for (size_t shorter = 0; shorter < 24 + 3 + longest; shorter++) {
        CHECK_EQUAL(stream_deliver(&stream, packet, shorter, true), -EBADMSG);
        before.count[RESTORE_RECEIVED] = ++before.count[RESTORE_REFUSED];
    }
    CHECK(!memcmp(&before, &stream.restore, sizeof before));
    struct media foreign = media_of(stream.next), far = media_of(stream.next + 2000);
    uint8_t large[RTP_DATAGRAM_MAX + 1] = {0};
    memcpy(large, foreign.data, 40);
    CHECK_EQUAL(stream_deliver(&stream, large, sizeof large, false), -EBADMSG);
    CHECK_EQUAL(stream_deliver(&stream, foreign.data, 12, false), -EBADMSG);
    put32(foreign.data + 8, SSRC + 1);
    CHECK_EQUAL(stream_deliver(&stream, foreign.data, foreign.size, false), -EBADMSG);
    CHECK_EQUAL(stream_deliver(&stream, far.data, far.size, false), -ERANGE);
    before.stranger.next = (uint16_t)(stream.next + 2001);
    before.stranger.there = true;
    CHECK(!memcmp(&before, &stream.restore, sizeof before));
    put32(packet + 20, newest - 400); /* old, but valid */
    CHECK_EQUAL(stream_deliver(&stream, packet, size, true), -EALREADY);
    CHECK_EQUAL(count(RESTORE_EXPIRED), 1);
    check_alive();
}

/* Numbers from far away: one is a stray packet, two are a new place in the count. */
static void test_jump(void) {
    for (unsigned i = 0; i < 4; i++) {
        const uint32_t distance[] = {1500, 40000, (uint32_t)-300, (uint32_t)-5000};
        stream_begin(&stream, 70000);
        stream_lose(&stream, 8, 0x12);
        CHECK_EQUAL(stream_repair(&stream, 70001), 0);
        CHECK_EQUAL(stream_source(&stream, stream.next + distance[i] - 1), -ERANGE);
        stream_lose(&stream, 1, 0);
        stream.next += distance[i] - 1;
        CHECK_EQUAL(stream_source(&stream, stream_send(&stream, 0)), -ERANGE); /* does not follow directly */
        CHECK_EQUAL(stream.restore.rows, 1);
        CHECK_EQUAL(stream_source(&stream, stream_send(&stream, 0)), 0);
        CHECK_EQUAL(stream.restore.rows, 0);
        check_alive();
    }
}

/* Writes a repair packet for the lost packet `esi` alone, with other contents. */
static size_t forge(uint32_t esi, const struct media *media) {
    struct stream *other = malloc(sizeof *other);
    stream_init(other, esi);
    CHECK(!repair_window_add(&other->window, esi, 0, media->data, media->size));
    size_t size = repair_make(&other->window, esi, packet);
    free(other);
    return size;
}

static unsigned taken(void) {
    const uint8_t *data;
    size_t size;
    uint16_t sequence;
    unsigned packets = 0;
    while (restore_take(&stream.restore, &data, &size, &sequence)) {
        struct rtp_packet rtp;
        CHECK(size <= RTP_DATAGRAM_MAX && rtp_parse(data, size, &rtp));
        CHECK(rtp.ssrc == SSRC && rtp.sequence == sequence);
        packets++;
    }
    return packets;
}

/* A restored packet that is not the missing one is dropped; the right one can be restored afterwards. */
static void test_forged(void) {
    for (unsigned i = 0; i < 12; i++) {
        stream_begin(&stream, 65531 + i * 10);
        stream_lose(&stream, 4, 2);
        uint32_t lost = stream.next - 3;
        struct media media = media_of(lost);
        if (i < 4)
            media.data[8 + i] ^= 1; /* SSRC */
        else if (i < 6)
            media.data[2 + i % 2] ^= 1; /* sequence number */
        else if (i == 6)
            media.data[0] ^= 0xc0;
        else if (i == 7)
            media.data[0] |= 0x2f; /* contributing sources and padding that do not exist */
        if (i == 7)
            media.size = 40, media.data[39] = 0;
        size_t size = forge(lost, &media);
        if (i >= 8) { /* lengths: longer than the symbol, shorter, none; and an unknown flow */
            uint8_t factor = 1;
            for (; packet[24 + 3] != gf256_multiply(factor, 0x80);)
                factor++;
            const uint32_t right = (uint32_t)media.size, wrong[] = {right + 1, right - 1, 0, 0x10000 + right};
            packet[24] = gf256_multiply(factor, (uint8_t)(wrong[i - 8] >> 16));
            packet[25] = gf256_multiply(factor, (uint8_t)(wrong[i - 8] >> 8));
            packet[26] = gf256_multiply(factor, (uint8_t)wrong[i - 8]);
        }
        stream_deliver(&stream, packet, size, true);
        CHECK_EQUAL(taken(), 0);
        CHECK_EQUAL(count(RESTORE_CORRUPT), 1);
        check_rows(&stream.restore);
        CHECK_EQUAL(stream_repair(&stream, lost), 0);
        stream_take(&stream);
        CHECK_EQUAL(stream.restored, 1);
        check_alive();
    }
}

/* Equations that contradict each other are all dropped; new ones count again. */
static void test_contradiction(void) {
    stream_begin(&stream, 65532);
    stream_lose(&stream, 6, 0x2);
    uint32_t lost = stream.next - 5;
    struct media media = media_of(lost);
    media.data[media.size - 1] ^= 1; /* no header reveals this */
    CHECK_EQUAL(stream_deliver(&stream, packet, forge(lost, &media), true), 0);
    CHECK_EQUAL(taken(), 1);
    CHECK_EQUAL(stream.restore.wrong, 0);
    stream_lose(&stream, 4, 0x5);
    uint32_t first = stream.next - 4;
    CHECK_EQUAL(stream_repair(&stream, first), 0);
    CHECK_EQUAL(stream_source(&stream, lost), -EALREADY); /* the real packet comes: the restored one was forged */
    CHECK_EQUAL(stream.restore.wrong, 1);
    CHECK_EQUAL(count(RESTORE_CORRUPT), 1);
    check_rows(&stream.restore);
    CHECK_EQUAL(stream_repair(&stream, lost), 0); /* the real packet has replaced the forged one */
    CHECK_EQUAL(stream_repair(&stream, lost), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 2);

    /* Two unknown packets, a right and a wrong equation, then another right one: none of them counts. */
    stream_lose(&stream, 4, 0x5);
    first = stream.next - 4;
    CHECK_EQUAL(stream_repair(&stream, first), 0);
    size_t size = repair_make(&stream.window, first, packet);
    packet[size - 1] ^= 1;
    packet[26] ^= 1;
    stream_deliver(&stream, packet, size, true);
    CHECK_EQUAL(taken(), 0);
    CHECK_EQUAL(stream.restore.rows, 0);
    CHECK_EQUAL(count(RESTORE_CORRUPT), 3);
    CHECK_EQUAL(stream_repair(&stream, first), 0);
    CHECK_EQUAL(stream_repair(&stream, first), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 4);
    check_alive();
}

/* A repair packet that claims packets not yet sent does not block them. */
static void test_ahead(void) {
    stream_begin(&stream, 65500);
    stream_lose(&stream, 4, 2);
    size_t size = repair_make(&stream.window, 65501, packet);
    put16(packet + 18, 0xf000 + RESTORE_AHEAD);
    CHECK_EQUAL(stream_deliver(&stream, packet, size, true), 0);
    CHECK_EQUAL(stream_repair(&stream, 65501), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1);
    for (unsigned i = 0; i < 300; i++)
        stream_lose(&stream, 1, 0);
    CHECK_EQUAL(stream.restore.rows, 0);
    check_alive();
}

/* Garbage and altered packets of the stream: restored packets are RTP packets of this stream. */
static void test_garbage(void) {
    unsigned restored = 0, changed = 0;
    seed = 7;
    stream_begin(&stream, 65000);
    for (unsigned i = 0; i < 12000; i++) {
        uint32_t esi = stream_send(&stream, (uint16_t)(i / 3));
        if (next_random(3))
            stream_source(&stream, esi);
        size_t size = repair_make(&stream.window, esi - next_random(next_random(4) ? 4 : 40), packet);
        unsigned kind = next_random(6), from = kind < 2 ? 2 : 24;
        for (unsigned bytes = kind < 4 ? 1 + next_random(4) : 0; bytes; bytes--) {
            packet[from + next_random((unsigned)size - from)] = (uint8_t)next_random(256);
            changed += bytes == 1;
        }
        if (kind == 5)
            for (size_t at = 24; at < size; at++)
                packet[at] = (uint8_t)next_random(256);
        stream_deliver(&stream, packet, next_random(20) ? size : next_random((unsigned)size + 1), true);
        restored += taken();
        if (i % 64 == 0)
            restore_give_up(&stream.restore, (uint16_t)(esi - next_random(70)));
        if (i % 64 == 0)
            check_rows(&stream.restore);
    }
    CHECK(restored > 500 && changed > 5000);
    CHECK(count(RESTORE_REFUSED) > 500 && count(RESTORE_CORRUPT) > 500 && count(RESTORE_EXPIRED) > 100);
    for (unsigned i = 0; i < 300; i++) /* until forged packets have left the window */
        stream_lose(&stream, 1, 0);
    check_alive();
}

int main(void) {
    test_impossible();
    test_jump();
    test_forged();
    test_contradiction();
    test_ahead();
    test_garbage();
    return 0;
}
