/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Repair packets: their bytes, the packets they cover, and invalid ones. */
#include "repair_stream.h"

#include "bits.h"
#include "gf256.h"

static struct stream stream;
static uint8_t packet[REPAIR_MAX];

static struct repair_packet make(uint32_t first) {
    struct repair_packet parsed;
    CHECK(repair_parse(packet, repair_make(&stream.window, first, packet), &parsed));
    return parsed;
}

/* Each byte, from the RFCs, for three packets of different sizes around a wrap. */
static void test_bytes(void) {
    stream_init(&stream, 0x1fffd);
    for (int i = 0; i < 4; i++)
        stream_send(&stream, 1);
    stream.window.sequence = 0xabcd;
    size_t size = repair_make(&stream.window, 0x1fffe, packet);
    uint8_t expected[REPAIR_MAX] = {0x81, 98, 0xab, 0xcd, 0,    0,    0,    0, 0, 0,    0x20, 0x02,
                                    0,    0,  0x10, 0x01, 0xab, 0xcd, 0xf0, 3, 0, 0x01, 0xff, 0xfe};
    put32(expected + 4, 0x20000 * 90);
    uint8_t factor[3];
    size_t longest = 0;
    repair_coefficients(0xabcd, factor, 3);
    for (uint32_t i = 0; i < 3; i++) {
        struct media media = media_of(0x1fffe + i);
        uint8_t symbol[SYMBOL_MAX] = {0};
        put16(symbol + 1, (uint16_t)media.size);
        memcpy(symbol + 3, media.data, media.size);
        for (size_t j = 0; j < SYMBOL_MAX; j++)
            expected[24 + j] ^= gf256_multiply(factor[i], symbol[j]);
        longest = media.size > longest ? media.size : longest;
    }
    CHECK_EQUAL(size, 24 + 3 + longest);
    CHECK(!memcmp(packet, expected, sizeof expected > size ? size : sizeof expected));

    struct repair_packet parsed;
    CHECK(repair_parse(packet, size, &parsed));
    CHECK_EQUAL(parsed.sequence, 0xabcd);
    CHECK_EQUAL(parsed.key, 0xabcd);
    CHECK_EQUAL(parsed.time, 0x20000 * 90);
    CHECK_EQUAL(parsed.ssrc, REPAIR_SSRC);
    CHECK_EQUAL(parsed.media_ssrc, SSRC);
    CHECK_EQUAL(parsed.count, 3);
    CHECK_EQUAL(parsed.first, 0x1fffe);
    CHECK(parsed.symbol == packet + 24 && parsed.size == size - 24);
    CHECK_EQUAL(make(0x1fffe).key, 0xabce); /* each one is different */
}

/* The example of docs/streaming.md. */
static void test_example(void) {
    static const char expected[] = "816200010000005a00002002000010010001f002000000070000a3aef200a0000000700000dcc4364c";
    char found[2 * REPAIR_MAX + 1] = "";
    repair_window_init(&stream.window, SSRC, REPAIR_SSRC, 1);
    for (uint32_t esi = 7; esi < 9; esi++) {
        uint8_t data[14];
        struct rtp_packet rtp = {.type = RTP_H264, .sequence = (uint16_t)esi, .time = 90, .ssrc = SSRC};
        memcpy(data + rtp_write(data, &rtp), "ab", 2);
        CHECK(!repair_window_add(&stream.window, esi, 1, data, esi == 7 ? 13 : 14));
    }
    size_t size = repair_make(&stream.window, 0, packet);
    for (size_t i = 0; i < size; i++)
        sprintf(found + 2 * i, "%02x", packet[i]);
    CHECK(!strcmp(found, expected));
}

/* The window: from `first`, at most 25 frames and 256 packets, always up to the newest packet. */
static void test_window(void) {
    stream_init(&stream, 1000);
    CHECK_EQUAL(repair_make(&stream.window, 1000, packet), 0);
    for (unsigned i = 0; i < 400; i++) {
        stream_send(&stream, (uint16_t)(65530 + i / 10)); /* the frame's number wraps, too */
        unsigned all = i < 250 ? i + 1 : 240 + i % 10 + 1;
        CHECK_EQUAL(make(0).count, all);
        CHECK_EQUAL(make(1000 + i).count, 1);
        CHECK_EQUAL(make(1000 + i).first, 1000 + i);
        CHECK_EQUAL(make(1000 + i + 1).count, 1); /* not sent yet */
        CHECK_EQUAL(make(1000 + i + 70000).count, 1);
        CHECK_EQUAL(make(1000 + i - 2).count, all < 3 ? all : 3);
    }
    stream_init(&stream, UINT32_MAX - 100); /* large frames */
    for (unsigned i = 0; i < 400; i++) {
        stream_send(&stream, (uint16_t)(i / 100));
        struct repair_packet parsed = make(UINT32_MAX - 100);
        CHECK_EQUAL(parsed.count, i < 256 ? i + 1 : 256);
        CHECK_EQUAL(parsed.first + parsed.count, stream.next);
    }
    stream.next += 5; /* a gap in the numbers: old and new packets are not mixed */
    stream_send(&stream, 4);
    CHECK_EQUAL(make(0).count, 1);
    stream_send(&stream, 4 + 25);
    CHECK_EQUAL(make(0).count, 1);

    static const uint8_t data[RTP_PACKET_MAX + 1] = {0x80};
    CHECK_EQUAL(repair_window_add(&stream.window, stream.next, 29, data, RTP_PACKET_MAX + 1), -EMSGSIZE);
    CHECK_EQUAL(repair_window_add(&stream.window, stream.next, 29, data, 11), -EMSGSIZE);
    CHECK_EQUAL(make(0).count, 1);
    CHECK_EQUAL(repair_window_add(&stream.window, stream.next, 29, data, RTP_PACKET_MAX), 0);
    CHECK_EQUAL(repair_make(&stream.window, 0, packet), REPAIR_MAX);
}

static void test_refused(void) {
    static const struct {
        unsigned at, value;
    } bad[] = {{0, 0x80}, {0, 0x82},  {0, 0x91},  {0, 0xa1},  {0, 0x01},  {1, 96}, {1, 97},
               {1, 99},   {18, 0xe0}, {18, 0x00}, {18, 0xff}, {18, 0xf1}, {19, 0}};
    struct repair_packet parsed;
    stream_init(&stream, 1);
    stream_send(&stream, 1);
    size_t size = repair_make(&stream.window, 1, packet);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        uint8_t copy[REPAIR_MAX];
        memcpy(copy, packet, size);
        copy[bad[i].at] = (uint8_t)bad[i].value;
        CHECK(!repair_parse(copy, size, &parsed));
    }
    packet[1] |= 0x80; /* the marker is ignored */
    packet[18] = 0xf1;
    packet[19] = 0;
    CHECK(repair_parse(packet, size, &parsed));
    CHECK_EQUAL(parsed.count, 256);
    for (size = 0; size <= REPAIR_MAX + 1; size++) {
        uint8_t *copy = calloc(1, size ? size : 1);
        memcpy(copy, packet, size < REPAIR_MAX ? size : REPAIR_MAX);
        CHECK(repair_parse(copy, size, &parsed) == (size >= 24 + 3 + 12 && size <= REPAIR_MAX));
        free(copy);
    }
}

/* A probe: a header alone, with a number of the repair stream. */
static void test_probe(void) {
    struct repair_packet parsed;

    stream_init(&stream, 0x1fffe);
    CHECK_EQUAL(repair_probe(&stream.window, packet), 0); /* nothing was sent yet */
    stream_send(&stream, 1);
    stream.window.sequence = 0xffff;
    CHECK_EQUAL(repair_probe(&stream.window, packet), REPAIR_HEADER);
    CHECK(repair_parse(packet, REPAIR_HEADER, &parsed));
    CHECK(parsed.sequence == 0xffff && !parsed.count && !parsed.size && parsed.first == 0x1ffff);
    CHECK_EQUAL(stream.window.sequence, 0);
    CHECK(!repair_parse(packet, REPAIR_HEADER + 39, &parsed)); /* a symbol of no packet */
}

int main(void) {
    test_probe();
    test_bytes();
    test_example();
    test_window();
    test_refused();
    return 0;
}
