/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Encrypted streams: packets that an independent program encrypted, round trips, wrong keys, forged and repeated
 * packets, sequence wraps, receivers that start late, and restarts.
 */
#include "secure.h"

#include <errno.h>

#include "bits.h"
#include "ddxvideo_secure.h"

#define OTHER "e1f97a0d3e018be0d64fa32c06de41390ec675ad498afeebb6960b3aabe7" /* another key */
#define REPORT 12                                                            /* bytes of a report */
#define HEADER 20                                                            /* bytes, with an extension of one word */

/* A packet like the sender's: an extension, then a payload that depends on the number. */
static void make(struct packet *packet, uint32_t ssrc, uint16_t sequence, size_t payload) {
    const uint8_t extension[] = {0xbe, 0xde, 0, 1, 0x22, 0, 7, 25};

    packet->data[0] = 0x90;
    packet->data[1] = 96;
    put32(put32(put16(packet->data + 2, sequence), 0xdecafbad), ssrc);
    memcpy(packet->data + 12, extension, sizeof extension);
    for (size_t i = 0; i < payload; i++)
        packet->data[HEADER + i] = (uint8_t)(i * 7 + sequence);
    packet->size = HEADER + payload;
}

static void protect(struct secure *sender, struct packet *packet, uint32_t ssrc, uint16_t sequence) {
    make(packet, ssrc, sequence, 600);
    CHECK_EQUAL(secure_protect(sender, packet->data, &packet->size), 0);
}

/* The sender's next packets up to this extended sequence number; the last one is the result. */
static void go_on(struct secure *sender, struct packet *packet, uint32_t from, uint32_t to) {
    while (from != to) {
        from += to - from < 30000 ? to - from : 30000;
        protect(sender, packet, SSRC, (uint16_t)from);
    }
}

static int unprotect(struct secure *receiver, const struct packet *packet) {
    struct packet copy = *packet, plain;
    int error = secure_unprotect(receiver, copy.data, &copy.size);

    if (error) {
        CHECK(copy.size == packet->size && !memcmp(copy.data, packet->data, copy.size));
        return error;
    }
    make(&plain, get32(copy.data + 8), get16(copy.data + 2), 600);
    CHECK(copy.size == plain.size && !memcmp(copy.data, plain.data, plain.size));
    return 0;
}

static void check_counts(const struct secure_count *count, unsigned good, unsigned refused, unsigned repeated) {
    CHECK_EQUAL(count->good, good);
    CHECK_EQUAL(count->refused, refused);
    CHECK_EQUAL(count->repeated, repeated);
}

/* A round trip restores any packet: with and without extension, contributing sources, payload. */
static void test_round_trip(void) {
    static const uint8_t headers[][28] = {{0x80, 98},
                                          {0x81, 98},
                                          {0x8f, 98},
                                          {0x90, 96, [12] = 0xbe, 0xde, 0, 0},
                                          {0x90, 96, [12] = 0x10, 0, 0, 1},
                                          {0x90, 96, [12] = 0xbe, 0xde, 0, 1, 0x22, 1, 2, 3},
                                          {0x91, 96, [16] = 0xbe, 0xde, 0, 2, 0x22, 1, 2, 3, 0x42}};
    struct secure *sender = secure_with(KEY), *receiver = secure_with(KEY);
    struct packet packet, plain = {.size = 0};
    uint16_t sequence = 65000;

    for (size_t i = 0; i < sizeof headers / sizeof *headers; i++)
        for (size_t size = 72; size < 1300; size += 3) {
            memset(plain.data, (int)size, size);
            memcpy(plain.data, headers[i], sizeof *headers);
            put32(put16(plain.data + 2, ++sequence) + 4, SSRC);
            plain.size = size;
            packet = plain;
            CHECK_EQUAL(secure_protect(sender, packet.data, &packet.size), 0);
            CHECK(packet.size >= size + 10 && packet.size <= size + SECURE_GROWTH);
            CHECK_EQUAL(secure_unprotect(receiver, packet.data, &packet.size), 0);
            CHECK(packet.size == size && !memcmp(packet.data, plain.data, size));
        }
    CHECK_EQUAL(secure_received(receiver)->refused, 0);
    secure_close(sender);
    secure_close(receiver);
}

static void test_reports(void) {
    struct secure *sender = secure_with(KEY), *receiver = secure_with(KEY);
    struct packet packet, copy;

    for (unsigned i = 0; i < 1000; i++) {
        packet.size = REPORT;
        put32(put32(put32(packet.data, 0x81ce0002), i % SECURE_PEERS), SSRC); /* each reporter has a separate state */
        CHECK_EQUAL(secure_protect_report(receiver, packet.data, &packet.size), 0);
        CHECK_EQUAL(packet.size, REPORT + SECURE_REPORT_GROWTH);
        copy = packet;
        CHECK_EQUAL(secure_unprotect_report(sender, packet.data, &packet.size), 0);
        CHECK(packet.size == REPORT && get32(packet.data + 8) == SSRC);
        CHECK_EQUAL(secure_unprotect_report(sender, copy.data, &copy.size), -EALREADY);
    }
    for (size_t bit = 0; bit < copy.size * 8; bit++) {
        packet = copy;
        packet.data[bit / 8] ^= (uint8_t)(1 << bit % 8);
        CHECK(secure_unprotect_report(sender, packet.data, &packet.size));
    }
    CHECK_EQUAL(secure_received_reports(sender)->good, 1000);
    secure_close(sender);
    secure_close(receiver);
}

static void test_wrong_key(void) {
    enum { PACKETS = 32 };
    struct secure *sender = secure_with(KEY), *receiver = secure_with(OTHER);
    struct packet packet;

    for (uint16_t i = 0; i < PACKETS; i++) {
        protect(sender, &packet, SSRC, i);
        CHECK_EQUAL(unprotect(receiver, &packet), -EBADMSG);
    }
    check_counts(secure_received(receiver), 0, PACKETS, 0);
    make(&packet, SSRC, 1, 600); /* not encrypted at all */
    CHECK_EQUAL(unprotect(receiver, &packet), -EBADMSG);
    secure_close(receiver);
    receiver = secure_with(KEY);
    protect(sender, &packet, SSRC, PACKETS);
    CHECK_EQUAL(unprotect(receiver, &packet), 0);
    secure_close(receiver);
    secure_close(sender);
}

/* Each bit, each length; a refused packet changes neither itself nor the state. */
static void test_forged(void) {
    struct secure *sender = secure_with(KEY), *receiver = secure_with(KEY);
    struct packet packet, next, forged;
    unsigned refused = 0;

    protect(sender, &packet, SSRC, 4);
    protect(sender, &next, SSRC, 5);
    for (size_t bit = 0; bit < packet.size * 8; bit++, refused++) {
        forged = packet;
        forged.data[bit / 8] ^= (uint8_t)(1 << bit % 8);
        CHECK_EQUAL(unprotect(receiver, &forged), -EBADMSG);
    }
    for (forged = packet; forged.size--; refused++)
        CHECK_EQUAL(unprotect(receiver, &forged), -EBADMSG);
    CHECK_EQUAL(unprotect(receiver, &packet), 0);
    forged = packet; /* a later number, a higher counter */
    forged.data[3] = 8;
    forged.data[HEADER - 1] = 77;
    for (unsigned i = 0; i < 100; i++, refused++)
        CHECK_EQUAL(unprotect(receiver, &forged), -EBADMSG);
    CHECK_EQUAL(unprotect(receiver, &next), 0);
    check_counts(secure_received(receiver), 2, refused, 0);
    secure_close(sender);
    secure_close(receiver);
}

/* Packets in any order within the window, each once. */
static void test_replay(void) {
    static struct packet packets[SECURE_WINDOW + 2];
    struct secure *sender = secure_with(KEY), *receiver = secure_with(KEY);
    const unsigned count = SECURE_WINDOW + 2;

    for (unsigned i = 0; i < count; i++)
        protect(sender, packets + i, SSRC, (uint16_t)(65300 + i)); /* around a wrap */
    for (unsigned i = 0; i < 100; i++)
        CHECK_EQUAL(unprotect(receiver, packets + i), 0);
    for (unsigned i = count; i-- > 100;)
        CHECK_EQUAL(unprotect(receiver, packets + i), 0);
    for (unsigned i = 0; i < count; i++)
        CHECK_EQUAL(unprotect(receiver, packets + i), -EALREADY);
    check_counts(secure_received(receiver), count, 0, count);
    make(packets, SSRC, 65400, 600); /* nor is a number sent twice */
    CHECK_EQUAL(secure_protect(sender, packets->data, &packets->size), -EALREADY);
    secure_close(sender);
    secure_close(receiver);
}

/* A receiver that starts after wraps, or received nothing for half a wrap or longer, continues at the next counter. */
static void test_late(void) {
    static const uint32_t gaps[] = {20000, 32760, 33000, 65536, 100000, 1000001, 40u << 16};
    struct packet packet, old;

    for (size_t i = 0; i < sizeof gaps / sizeof *gaps; i++) {
        struct secure *sender = secure_with(KEY), *late = secure_with(KEY), *deaf = secure_with(KEY);
        uint32_t index = (uint32_t)i * 10000 + ROLLOVER_EVERY, refused = 0;

        index -= index % ROLLOVER_EVERY;
        protect(sender, &packet, SSRC, (uint16_t)index);
        CHECK_EQUAL(unprotect(deaf, &packet), 0);
        old = packet;
        go_on(sender, &packet, index, index + gaps[i]);
        for (index += gaps[i]; index++, true;) { /* up to the next packet with the counter */
            protect(sender, &packet, SSRC, (uint16_t)index);
            if (index % ROLLOVER_EVERY == 0)
                break;
            unprotect(deaf, &packet);
            unprotect(late, &packet);
            refused++;
        }
        CHECK(refused < ROLLOVER_EVERY);
        for (unsigned more = 0; more < 10; more++) {
            CHECK_EQUAL(unprotect(late, &packet), 0);
            CHECK_EQUAL(unprotect(deaf, &packet), 0);
            protect(sender, &packet, SSRC, (uint16_t)++index);
        }
        CHECK(unprotect(deaf, &old)); /* an old packet has no effect */
        CHECK_EQUAL(unprotect(deaf, &packet), 0);
        secure_close(sender);
        secure_close(late);
        secure_close(deaf);
    }
}

/* A source that sends no counters is received across its wraps. */
static void test_no_counters(void) {
    struct secure *sender = secure_with(KEY), *receiver = secure_with(KEY);
    struct packet packet;

    for (uint32_t index = 1; index < 5u << 16; index += 10002) {
        while (index % ROLLOVER_EVERY == 0)
            index++;
        protect(sender, &packet, SSRC, (uint16_t)index);
        uint32_t counter;
        CHECK(!rollover_get(packet.data, packet.size, &counter));
        CHECK_EQUAL(unprotect(receiver, &packet), 0);
    }
    secure_close(sender);
    secure_close(receiver);
}

/* The sender restarts with other SSRCs, the receiver with an empty state; both keep a bounded number of sources. */
static void test_restarts(void) {
    struct secure *receiver = secure_with(KEY);
    struct packet packet;

    for (uint32_t ssrc = 1; ssrc <= 3 * SECURE_PEERS; ssrc++) {
        struct secure *sender = secure_with(KEY);
        for (uint16_t i = 0; i < 10; i++) {
            protect(sender, &packet, ssrc, (uint16_t)(65530 + i));
            CHECK_EQUAL(unprotect(receiver, &packet), 0);
            protect(sender, &packet, ~ssrc, i); /* repair packets, beside it */
            CHECK_EQUAL(unprotect(receiver, &packet), 0);
        }
        secure_close(sender);
    }
    struct secure *again = secure_with(KEY);
    CHECK_EQUAL(unprotect(again, &packet), 0);
    for (uint32_t ssrc = 0; ssrc < SECURE_PEERS; ssrc++)
        protect(again, &packet, ssrc, 1);
    make(&packet, SECURE_PEERS, 1, 600);
    CHECK_EQUAL(secure_protect(again, packet.data, &packet.size), -ENOSPC);
    packet.size = 11;
    CHECK_EQUAL(secure_protect(again, packet.data, &packet.size), -EINVAL);
    secure_close(again);
    secure_close(receiver);
}

int main(void) {
    scratch_make();
    test_round_trip();
    test_reports();
    test_wrong_key();
    test_forged();
    test_replay();
    test_late();
    test_no_counters();
    test_restarts();
    return 0;
}
