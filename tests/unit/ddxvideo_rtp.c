/* SPDX-License-Identifier: GPL-2.0-or-later */
/* RTP headers: ours are read back, those of other senders are parsed, broken ones are refused. */
#include "rtp.h"

#include "check.h"

static const struct rtp_packet example = {
    .type = RTP_H264,
    .marker = true,
    .sequence = 65534,
    .time = 0xdeadbeef,
    .ssrc = 0x12345678,
    .has_count = true,
    .has_source = true,
    .frame = {
        .count = 65535, .window = 25, .capture = INT64_C(1750000000123456789), .sequence = 4000000000u, .number = 77}};

static size_t write_example(uint8_t *data, const struct rtp_packet *packet) {
    size_t size = rtp_write(data, packet);
    CHECK(size <= RTP_HEADER_MAX && size % 4 == 0);
    data[size] = 0x65;
    return size + 1;
}

static void test_round_trip(void) {
    uint8_t data[RTP_HEADER_MAX + 1];
    struct rtp_packet packet;
    size_t size = write_example(data, &example);
    CHECK(rtp_parse(data, size, &packet));
    CHECK_EQUAL(packet.type, example.type);
    CHECK(packet.marker && packet.has_count && packet.has_source && !packet.frame.encrypted);
    CHECK_EQUAL(packet.sequence, example.sequence);
    CHECK_EQUAL(packet.time, example.time);
    CHECK_EQUAL(packet.ssrc, example.ssrc);
    CHECK_EQUAL(packet.frame.sequence, example.frame.sequence);
    CHECK_EQUAL(packet.frame.number, example.frame.number);
    CHECK_EQUAL(packet.frame.count, example.frame.count);
    CHECK_EQUAL(packet.frame.window, example.frame.window);
    CHECK_EQUAL(packet.size, 1);
    CHECK_EQUAL(packet.payload[0], 0x65);
    CHECK_EQUAL(size, RTP_HEADER_MAX + 1);

    struct rtp_packet later = example;
    later.has_source = false;
    later.frame.encrypted = true;
    size = write_example(data, &later);
    CHECK_EQUAL(size, RTP_HEADER_NEXT + 1);
    CHECK(rtp_parse(data, size, &packet) && packet.has_count && !packet.has_source);
    CHECK_EQUAL(packet.frame.count, example.frame.count);
    CHECK(packet.frame.encrypted);
    CHECK_EQUAL(packet.frame.window, example.frame.window);

    struct rtp_packet plain = example;
    plain.has_count = plain.has_source = plain.marker = false;
    size = write_example(data, &plain);
    CHECK_EQUAL(size, 12 + 1);
    CHECK(rtp_parse(data, size, &packet) && !packet.has_count && !packet.has_source && !packet.marker);
}

/* Each nanosecond survives NTP's 32.32 format, also around a full second. */
static void test_capture_time(void) {
    uint8_t data[RTP_HEADER_MAX + 1];
    const int64_t second = 1000000000;
    for (int64_t i = -5; i < 100000; i++) {
        struct rtp_packet packet, sent = example;
        sent.frame.capture = i < 5 ? 1750000000 * second + i : 1750000000 * second + i * 9999;
        CHECK(rtp_parse(data, write_example(data, &sent), &packet));
        CHECK_EQUAL(packet.frame.capture, sent.frame.capture);
    }
}

/* The bytes themselves, by RFC 3550, figure 1, and RFC 8285, 4.2. */
static void test_bytes(void) {
    uint8_t data[RTP_HEADER_MAX + 1];
    const uint8_t begin[] = {0x90, 0xe0, 0xff, 0xfe, 0xde, 0xad, 0xbe, 0xef, 0x12, 0x34, 0x56,
                             0x78, 0xbe, 0xde, 0x00, 0x06, 0x22, 0xff, 0xff, 25,   0x17};
    const uint8_t end[] = {0x37, 0xee, 0x6b, 0x28, 0x00, 0, 0, 0, 77, 0, 0, 0x65};
    CHECK_EQUAL(write_example(data, &example), sizeof(begin) + 8 + sizeof(end));
    CHECK(!memcmp(data, begin, sizeof(begin)));
    CHECK(!memcmp(data + sizeof(begin) + 8, end, sizeof(end)));

    struct rtp_packet later = example;
    later.has_source = false;
    const uint8_t short_end[] = {0xbe, 0xde, 0x00, 0x01, 0x22, 0xff, 0xff, 25, 0x65};
    CHECK_EQUAL(write_example(data, &later), 12 + sizeof(short_end));
    CHECK(!memcmp(data + 12, short_end, sizeof(short_end)));
}

/* Headers of other senders: contributing sources, padding, unknown elements, the two-byte form. */
static void test_others(void) {
    struct rtp_packet packet;
    const uint8_t sources[] = {0x82, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 9, 9, 9, 9, 8, 8, 8, 8, 0x41, 0x42};
    CHECK(rtp_parse(sources, sizeof(sources), &packet) && packet.size == 2 && packet.payload[0] == 0x41);
    CHECK(!rtp_parse(sources, 20, &packet)); /* no payload after the sources */

    const uint8_t padded[] = {0xa0, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0x41, 0, 0, 3};
    CHECK(rtp_parse(padded, sizeof(padded), &packet) && packet.size == 1);
    const uint8_t too_padded[] = {0xa0, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0x41, 0, 0, 5};
    CHECK(!rtp_parse(too_padded, sizeof(too_padded), &packet));
    const uint8_t unpadded[] = {0xa0, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0x41, 0, 0, 0};
    CHECK(!rtp_parse(unpadded, sizeof(unpadded), &packet));

    const uint8_t unknown[] = {
        0x90, 96, 0, 1,    0,    0,    0, 2, 0, 0, 0, 3,   0xbe,
        0xde, 0,  2, 0x30, 0xff, 0x21, 1, 2, 0, 0, 0, 0x41}; /* ids 3 and 2 of other lengths; padding */
    CHECK(rtp_parse(unknown, sizeof(unknown), &packet) && packet.size == 1 && !packet.has_count && !packet.has_source);
    uint8_t halves[RTP_HEADER_MAX + 1];
    for (int i = 0; i < 3; i++) { /* one of the three elements has an unknown id */
        static const size_t at[] = {16, 20, 29};
        size_t size = write_example(halves, &example);
        halves[at[i]] |= 0x40;
        CHECK(rtp_parse(halves, size, &packet) && packet.size == 1 && packet.has_count == (i > 0) &&
              !packet.has_source);
    }
    const uint8_t two_byte[] = {0x90, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0x10, 0, 0, 1, 1, 2, 3, 4, 0x41};
    CHECK(rtp_parse(two_byte, sizeof(two_byte), &packet) && packet.size == 1 && !packet.has_count);
    const uint8_t overlong[] = {0x90, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0xbe, 0xde, 0, 1, 0x17, 2, 3, 4, 0x41};
    CHECK(rtp_parse(overlong, sizeof(overlong), &packet) && !packet.has_count); /* an element beyond the extension */
    const uint8_t cut[] = {0x90, 96, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0xbe, 0xde, 0, 9, 1, 2, 3, 4, 0x41};
    CHECK(!rtp_parse(cut, sizeof(cut), &packet)); /* an extension beyond the packet */
}

static void test_cut_short(void) {
    uint8_t data[RTP_HEADER_MAX + 1];
    struct rtp_packet packet;
    size_t size = write_example(data, &example);
    for (size_t i = 0; i < size; i++) {
        uint8_t *part = malloc(i + 1); /* so that a sanitizer sees a read beyond it */
        memcpy(part, data, i);
        CHECK(!rtp_parse(part, i, &packet));
        free(part);
    }
    data[0] ^= 0xc0; /* version 1 */
    CHECK(!rtp_parse(data, size, &packet));
}

int main(void) {
    test_round_trip();
    test_capture_time();
    test_bytes();
    test_others();
    test_cut_short();
    return 0;
}
