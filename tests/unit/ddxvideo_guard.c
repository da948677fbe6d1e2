/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The datagrams that receivers with and without a key accept, and the messages about the others. */
#include "guard.h"

#include "ddxvideo_secure.h"
#include "rtp.h"

#define OTHER "000000000000000000000000000000000000000000000000000000000000"

/* A media packet of this stream. */
static void make(struct packet *packet, uint32_t ssrc, uint16_t sequence, bool encrypted) {
    const struct rtp_packet rtp = {.type = RTP_H264,
                                   .sequence = sequence,
                                   .ssrc = ssrc,
                                   .has_count = true,
                                   .frame = {.count = sequence, .encrypted = encrypted, .window = 25}};

    packet->size = rtp_write(packet->data, &rtp);
    memset(packet->data + packet->size, 0x65, 100);
    packet->size += 100;
}

/* The same, encrypted unless `secure` is NULL, as it comes to a receiver. */
static bool pass(struct guard *guard, struct secure *secure, uint32_t ssrc, uint16_t sequence) {
    struct packet packet, plain;

    make(&packet, ssrc, sequence, secure);
    plain = packet;
    if (secure)
        CHECK(!secure_protect(secure, packet.data, &packet.size));
    bool passed = guard_media(guard, packet.data, &packet.size);
    if (passed)
        CHECK(packet.size == plain.size && !memcmp(packet.data, plain.data, plain.size));
    return passed;
}

static void check_line(struct guard *guard, int64_t now, const char *wanted) {
    char text[GUARD_TEXT_MAX] = "";

    CHECK(guard_says(guard, now, text) == (*wanted != 0));
    CHECK(!*wanted || strstr(text, wanted));
}

static void test_without_key(void) {
    struct secure *secure = secure_with(KEY);
    struct guard guard = {0};

    for (uint16_t i = 0; i < GUARD_DOUBT; i++) {
        check_line(&guard, i, "");
        CHECK(!pass(&guard, secure, SSRC, i));
        CHECK(pass(&guard, NULL, 1, i));
    }
    check_line(&guard, 100, "nothing is shown of SSRC cafebabe: it is encrypted; give its key: -key FILE");
    check_line(&guard, 100 + 2 * GUARD_QUIET_NS, "");
    CHECK_EQUAL(guard.count[GUARD_REFUSED], GUARD_DOUBT);
    CHECK_EQUAL(guard.count[GUARD_REPEATED], 0);
    secure_close(secure);
}

/* A repair packet, by the source that it names. */
static void test_repair_without_key(void) {
    uint8_t data[100] __attribute__((aligned(4))) = {0x81, 98, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0xca, 0xfe, 0xba, 0xbe};
    struct secure *secure = secure_with(KEY);
    struct guard guard = {0};
    size_t size = sizeof data;

    CHECK(guard_repair(&guard, data, &size));
    CHECK(!pass(&guard, secure, SSRC, 0));
    CHECK(!guard_repair(&guard, data, &size));
    data[15]++;
    CHECK(guard_repair(&guard, data, &size));
    for (size = 0; size < 16; size++)
        CHECK(guard_repair(&guard, data, &size));
    CHECK_EQUAL(guard.count[GUARD_REFUSED], 2);
    secure_close(secure);
}

/* A forged packet that claims that the stream is encrypted does not affect the shown stream. */
static void test_repair_of_a_shown_stream(void) {
    uint8_t data[100] __attribute__((aligned(4))) = {0x81, 98, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0xca, 0xfe, 0xba, 0xbe};
    struct secure *secure = secure_with(KEY);
    struct guard guard = {0};
    size_t size = sizeof data;

    CHECK(!pass(&guard, secure, SSRC, 0));
    CHECK(!guard_repair(&guard, data, &size));
    CHECK(pass(&guard, NULL, SSRC, 1));
    guard_show(&guard, SSRC);
    for (uint16_t i = 1; i < 2 * GUARD_DOUBT; i++) {
        CHECK(!pass(&guard, secure, SSRC, i));
        CHECK(guard_repair(&guard, data, &size));
    }
    check_line(&guard, 0, "");
    data[15]++;
    CHECK(!pass(&guard, secure, SSRC + 1, 0));
    CHECK(!guard_repair(&guard, data, &size));
    secure_close(secure);
}

static void test_with_key(void) {
    struct secure *sender = secure_with(KEY), *other = secure_with(OTHER);
    struct guard guard = {.path = "stream.key", .secure = secure_with(KEY)};

    for (uint16_t i = 0; i < GUARD_DOUBT; i++) {
        CHECK(pass(&guard, sender, SSRC, i));
        CHECK(!pass(&guard, other, SSRC, GUARD_DOUBT + i)); /* forged packets of a good source */
        CHECK(!pass(&guard, other, 1, i));
        CHECK(!pass(&guard, NULL, 2, i));
    }
    check_line(&guard, 0, "SSRC 00000001: it is encrypted with another key than that of -key stream.key");
    check_line(&guard, GUARD_QUIET_NS - 1, "");
    check_line(&guard, GUARD_QUIET_NS, "SSRC 00000002: it is not encrypted, unlike -key stream.key");
    check_line(&guard, 3 * GUARD_QUIET_NS, "");
    CHECK_EQUAL(guard.count[GUARD_REFUSED], 3 * GUARD_DOUBT);
    for (uint32_t ssrc = 10; ssrc < 1000; ssrc++) /* a flood; single packets are not reported */
        CHECK(!pass(&guard, NULL, ssrc, 0));
    CHECK(pass(&guard, sender, SSRC, GUARD_DOUBT));
    check_line(&guard, 5 * GUARD_QUIET_NS, "");
    secure_close(guard.secure);
    secure_close(other);
    secure_close(sender);
}

static void test_repeated_and_cut_off(void) {
    struct secure *sender = secure_with(KEY);
    struct guard guard = {.path = "stream.key", .secure = secure_with(KEY)};
    struct packet packet, copy;

    make(&packet, SSRC, 1, true);
    CHECK(!secure_protect(sender, packet.data, &packet.size));
    copy = packet;
    CHECK(guard_media(&guard, packet.data, &packet.size));
    packet = copy;
    CHECK(!guard_media(&guard, packet.data, &packet.size));
    CHECK_EQUAL(guard.count[GUARD_REPEATED], 1);
    for (packet.size = 0; packet.size < copy.size; packet.size++)
        CHECK(!guard_media(&guard, packet.data, &packet.size));
    packet.size = SECURE_PACKET_MAX + 1; /* longer than the buffer: the rest was cut off */
    CHECK(!guard_media(&guard, packet.data, &packet.size));
    CHECK_EQUAL(guard.count[GUARD_REFUSED] + guard.count[GUARD_REPEATED], 1 + copy.size + 1);
    struct guard open = {0};
    CHECK(guard_media(&open, packet.data, &packet.size)); /* for stream_rx.h to count as garbage */
    secure_close(guard.secure);
    secure_close(sender);
}

int main(void) {
    test_without_key();
    test_repair_without_key();
    test_repair_of_a_shown_stream();
    test_with_key();
    test_repeated_and_cut_off();
    return 0;
}
