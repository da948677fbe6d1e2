/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Lost packets are restored byte for byte, with losses, delays and duplicates, from about as many repair packets. */
#include "repair_stream.h"

static struct stream stream;

static unsigned missing(uint16_t *base) {
    unsigned found;
    uint16_t highest;
    CHECK(restore_missing(&stream.restore, &found, base, &highest));
    return found;
}

static uint64_t count(enum restore_count which) {
    return stream.restore.count[which];
}

/* Every pattern of losses among 12 packets, followed by the repair packets. */
static void test_patterns(void) {
    for (unsigned lost = 0; lost < 4096; lost++) {
        unsigned losses = (unsigned)__builtin_popcount(lost), made = 0, left;
        uint32_t first = lost % 2 ? 65530 : 131072 + lost;
        uint16_t base;
        stream_begin(&stream, first - 1);
        stream.window.sequence = (uint16_t)(lost * 16);
        stream_lose(&stream, 12, lost);
        while (stream.restored < losses) {
            CHECK(made < losses + 2);
            made++;
            left = missing(&base);
            int result = stream_repair(&stream, first);
            bool known = made > 1 || !(lost >> 11 & 1);
            CHECK(result == 0 || result == -EALREADY);
            if (known)
                CHECK_EQUAL(missing(&base), left - (result == 0));
            stream_take(&stream);
        }
        CHECK_EQUAL(missing(&base), 0);
        CHECK_EQUAL(base, (uint16_t)stream.next);
        if (losses)
            CHECK_EQUAL(stream_repair(&stream, first), -EALREADY);
        for (unsigned i = 0; i < 12; i++)
            CHECK(stream.has[(uint16_t)(first + i)]);
        if (lost % 16 == 15)
            check_rows(&stream.restore);
    }
}

/* The same with the repair packets first, and the media packets in reverse order. */
static void test_repair_first(void) {
    for (unsigned lost = 0; lost < 4096; lost++) {
        unsigned losses = (unsigned)__builtin_popcount(lost);
        stream_begin(&stream, lost % 2 ? 65530 : lost);
        stream.window.sequence = (uint16_t)(lost * 16);
        for (unsigned i = 0; i < 12; i++)
            stream_send(&stream, 0);
        for (unsigned i = 0; i < losses + 2; i++)
            stream_repair(&stream, stream.next - 12);
        stream_take(&stream); /* many losses: more repair packets than media packets */
        for (unsigned i = 0; i < 12; i++) {
            bool restored = stream.has[(uint16_t)(stream.next - 1 - i)];
            if (!(lost >> i & 1))
                CHECK_EQUAL(stream_source(&stream, stream.next - 1 - i), restored ? -EALREADY : 0);
            stream_take(&stream);
        }
        CHECK_EQUAL(stream.restore.rows, 0);
        for (uint32_t i = stream.next - 12; i != stream.next; i++)
            CHECK(stream.has[(uint16_t)i]);
        if (lost % 16 == 15)
            check_rows(&stream.restore);
    }
}

/* A packet that is given up drops one equation, not the others. */
static void test_give_up(void) {
    uint16_t base;
    stream_begin(&stream, 65533);
    stream_lose(&stream, 10, 0x111); /* 65534, 2 and 6 are lost */
    CHECK_EQUAL(missing(&base), 3);
    CHECK_EQUAL(base, 65534);
    CHECK_EQUAL(stream_repair(&stream, 65534), 0);
    CHECK_EQUAL(stream_repair(&stream, 65534), 0);
    CHECK_EQUAL(missing(&base), 1);
    restore_give_up(&stream.restore, 65534);
    CHECK_EQUAL(stream.restore.rows, 2);
    restore_give_up(&stream.restore, 0);
    restore_give_up(&stream.restore, 65000); /* changes nothing */
    CHECK_EQUAL(count(RESTORE_EXPIRED), 1);
    CHECK_EQUAL(missing(&base), 1);
    CHECK_EQUAL(base, 2);
    check_rows(&stream.restore);
    CHECK_EQUAL(stream_repair(&stream, 65534), -EALREADY); /* covers a packet that was given up */
    CHECK_EQUAL(count(RESTORE_EXPIRED), 2);
    CHECK_EQUAL(stream_repair(&stream, 65536), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 2);
    CHECK_EQUAL(missing(&base), 0);

    /* A packet that was given up comes late: repair packets that cover it are useful again. */
    CHECK_EQUAL(stream_source(&stream, 65534), 0);
    stream_lose(&stream, 1, 1);
    CHECK_EQUAL(stream_repair(&stream, 65534), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 3);
    restore_give_up(&stream.restore, (uint16_t)(stream.next + 1000)); /* not beyond the newest packet */
    stream_lose(&stream, 2, 1);
    CHECK_EQUAL(missing(&base), 1);
    check_rows(&stream.restore);
}

/* A repair packet that comes when one of the packets that it covers has left the window. */
static void test_old_repair(void) {
    uint8_t old[REPAIR_MAX];
    stream_begin(&stream, 65000);
    stream_lose(&stream, 20, 1 << 19);
    stream_lose(&stream, 10, 0);
    size_t size = repair_make(&stream.window, 65010, old);
    for (unsigned i = 0; i < 230; i++)
        stream_lose(&stream, 1, 0);
    CHECK_EQUAL(stream_source(&stream, 65004), -ERANGE); /* 256 before the newest one */
    CHECK_EQUAL(stream_source(&stream, 65005), -EALREADY);
    for (unsigned i = 0; i < 10; i++)
        stream_lose(&stream, 1, 0);
    CHECK_EQUAL(stream_deliver(&stream, old, size, true), -EALREADY);
    CHECK_EQUAL(count(RESTORE_EXPIRED), 1);
    CHECK_EQUAL(stream_repair(&stream, 65020), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1);
}

/* Packets outside the window are forgotten. */
static void test_window(void) {
    uint16_t base;
    stream_begin(&stream, 65000);
    stream_lose(&stream, 8, 0x11);
    CHECK_EQUAL(stream_repair(&stream, 65001), 0);
    for (unsigned i = 8; i < 300; i++) {
        stream_lose(&stream, 1, 0);
        CHECK_EQUAL(stream.restore.rows, i < 256);
        CHECK_EQUAL(missing(&base), i < 256 + 4);
    }
    CHECK_EQUAL(count(RESTORE_EXPIRED), 1);
    CHECK_EQUAL(stream_source(&stream, 65001), -ERANGE);
    stream_lose(&stream, 1, 1);
    CHECK_EQUAL(stream_repair(&stream, stream.next - 2), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1);
    stream_lose(&stream, 1, 1);
    CHECK_EQUAL(stream_repair(&stream, stream.next - 1), 0);
    CHECK_EQUAL(stream.restore.ready, 1);
    for (unsigned i = 0; i < 256; i++)
        stream_lose(&stream, 1, 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1); /* the packet was not taken in time */
    stream_lose(&stream, 1, 1);
    stream_lose(&stream, 1, 1);
    CHECK_EQUAL(stream_repair(&stream, stream.next - 3), 0);
    stream.next += 700; /* an outage: the window begins after it */
    stream_lose(&stream, 1, 0);
    CHECK_EQUAL(stream.restore.rows, 0);
    CHECK_EQUAL(missing(&base), 255);
    check_rows(&stream.restore);
}

/* A probe is a packet of the stream, and changes nothing. */
static void test_probe(void) {
    uint8_t probe[REPAIR_MAX];

    stream_begin(&stream, 10);
    stream_lose(&stream, 3, 2);
    size_t size = repair_probe(&stream.window, probe);
    CHECK_EQUAL(restore_repair(&stream.restore, probe, size), -EALREADY);
    CHECK_EQUAL(count(RESTORE_USELESS), 1);
    probe[15]++; /* of another media stream */
    CHECK_EQUAL(restore_repair(&stream.restore, probe, size), -EBADMSG);
    check_rows(&stream.restore);
}

/* A packet that comes late, or twice, or was restored before. */
static void test_late(void) {
    uint16_t base;
    stream_begin(&stream, 10);
    stream_lose(&stream, 8, 0x2a); /* 12, 14 and 16 */
    CHECK_EQUAL(stream_repair(&stream, 11), 0);
    CHECK_EQUAL(stream_source(&stream, 12), 0); /* was the row's pivot */
    check_rows(&stream.restore);
    CHECK_EQUAL(missing(&base), 1);
    CHECK_EQUAL(base, 14);
    CHECK_EQUAL(stream_source(&stream, 12), -EALREADY);
    CHECK_EQUAL(stream_source(&stream, 16), 0); /* the row's other packet: now it is solved */
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1);
    CHECK_EQUAL(stream_source(&stream, 14), -EALREADY);
    CHECK_EQUAL(stream_source(&stream, 14), -EALREADY);
    CHECK_EQUAL(stream.restore.wrong, 0);
    CHECK_EQUAL(stream_repair(&stream, 11), -EALREADY);
    CHECK_EQUAL(count(RESTORE_USELESS), 1);
    check_rows(&stream.restore);

    stream_begin(&stream, 10); /* comes between being restored and being taken */
    stream_lose(&stream, 2, 1);
    CHECK_EQUAL(stream_repair(&stream, 11), 0);
    CHECK_EQUAL(stream.restore.ready, 1);
    CHECK_EQUAL(stream_source(&stream, 11), -EALREADY);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 0);
    CHECK_EQUAL(count(RESTORE_RESTORED), 1);
    check_rows(&stream.restore);

    stream_begin(&stream, 10); /* a repair packet that is older than one that was restored, and one that came twice */
    uint8_t old[REPAIR_MAX];
    stream_lose(&stream, 2, 2);
    size_t size = repair_make(&stream.window, 11, old);
    stream_lose(&stream, 2, 1);
    CHECK_EQUAL(stream_repair(&stream, 11), 0);
    CHECK_EQUAL(stream_deliver(&stream, old, size, true), 0);
    CHECK_EQUAL(stream_deliver(&stream, old, size, true), -EALREADY);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 2);
}

/* Packets before the first received one do not count as missing. */
static void test_begin(void) {
    uint16_t base, highest;
    unsigned found = 1;
    stream_init(&stream, 65530);
    for (unsigned i = 0; i < 8; i++)
        stream_send(&stream, 0);
    CHECK_EQUAL(stream_repair(&stream, 65530), -EALREADY);
    CHECK_EQUAL(stream_repair(&stream, 65536), -EALREADY);
    CHECK_EQUAL(stream.restore.rows, 0);
    CHECK(!restore_missing(&stream.restore, &found, &base, &highest));
    CHECK_EQUAL(found, 0);
    restore_give_up(&stream.restore, 5);
    CHECK_EQUAL(stream_source(&stream, stream.next - 2), 0);
    CHECK_EQUAL(missing(&base), 0);
    CHECK_EQUAL(stream_repair(&stream, 65530), -EALREADY);
    CHECK_EQUAL(stream_repair(&stream, stream.next - 2), 0);
    stream_take(&stream);
    CHECK_EQUAL(stream.restored, 1);
    restore_init(&stream.restore, SSRC + 1); /* the source has another SSRC now */
    CHECK_EQUAL(stream_source(&stream, stream.next - 2), -EBADMSG);
    CHECK_EQUAL(stream_repair(&stream, stream.next - 2), -EBADMSG);
    CHECK_EQUAL(count(RESTORE_REFUSED), 1);
}

int main(void) {
    test_patterns();
    test_repair_first();
    test_give_up();
    test_old_repair();
    test_window();
    test_probe();
    test_late();
    test_begin();
    return 0;
}
