/* SPDX-License-Identifier: GPL-2.0-or-later */
/* MPEG-4 payloads by the rules of RFC 6416: each begins at a header or at a resync marker. */
#include "payload.h"

#include "check.h"
#include "rtp.h"

#define STARTS_MAX 200
#define WIDTH 5000
#define HEIGHT 3001

/* Writes bits: this test builds its frames by ISO 14496-2, not with the tested code. */
struct writer {
    uint8_t data[100000];
    size_t bits;
    size_t start[STARTS_MAX]; /* where a payload may begin */
    int starts;
};

static struct writer frame;
static unsigned seed = 1;

static unsigned next_random(void) {
    seed = seed * 1664525u + 1013904223u;
    return seed >> 8;
}

static void put(unsigned count, unsigned value) {
    for (; count; count--, frame.bits++) {
        uint8_t *byte = &frame.data[frame.bits / 8];
        if (frame.bits % 8 == 0)
            *byte = 0;
        *byte |= (uint8_t)((value >> (count - 1) & 1) << (7 - frame.bits % 8));
    }
}

static void align(void) { /* 5.2.4: a zero, then ones */
    put(1, 0);
    while (frame.bits % 8)
        put(1, 1);
}

static void start_code(unsigned code) {
    put(32, 0x100 + code);
}

static unsigned fixed_bits; /* of fixed_vop_time_increment; 0: the frame rate is not fixed */

static void vol(unsigned resolution, bool control, bool vbv) {
    start_code(0x00); /* video object */
    start_code(0x20);
    put(1 + 8, 1);
    put(1, 1); /* is_object_layer_identifier */
    put(4 + 3, 0x11);
    put(4, 15); /* extended aspect ratio */
    put(8 + 8, 0x0c0b);
    put(1, control);
    if (control) {
        put(2 + 1, 3);
        put(1, vbv);
        for (int i = 0; vbv && i < 79; i++)
            put(1, 1);
    }
    put(2, 0);
    put(1, 1);
    put(16, resolution);
    put(1, 1);
    put(1, fixed_bits > 0);
    put(fixed_bits, 0);
    put(1, 1);
    put(13, WIDTH);
    put(1, 1);
    put(13, HEIGHT);
    put(1, 1);
    align();
}

/* A picture of `packets` video packets, with runs of 16 and more zero bits that are no markers. */
static void vop(bool predicted, unsigned fcode, unsigned time_bits, unsigned seconds, int packets, unsigned largest) {
    start_code(0xb6);
    put(2, predicted);
    for (; seconds; seconds--)
        put(1, 1);
    put(1, 0);
    put(1, 1);
    put(time_bits, 0);
    put(1, 1);
    put(1, 1);
    if (predicted)
        put(1, 0);
    put(3, 0);
    put(5, 9);
    if (predicted)
        put(3, fcode);
    unsigned zeros = predicted ? 15 + fcode : 16;
    for (int i = 0; i < packets; i++) {
        if (i) {
            align();
            frame.start[frame.starts++] = frame.bits / 8;
            put(zeros, 0);
            put(1, 1);
            put(9 + 5 + 1, 0x2a2a);
        }
        for (unsigned bytes = 20 + next_random() % largest; bytes; bytes--) {
            if (zeros > 16 && bytes % 50 == 0) { /* not a marker: too few zeros */
                put((8 - frame.bits % 8) % 8, 1);
                put(16, 0);
                put(8, 0x80);
            } else {
                put(8, 1 + next_random() % 255);
            }
        }
    }
    align();
}

static bool may_begin(size_t at) {
    for (int i = 0; i < frame.starts; i++)
        if (frame.start[i] == at)
            return true;
    return false;
}

/* Number of payloads that begin at a wrong place. */
static int bad_begins(struct mpeg4_packer *packer, bool (*next)(struct mpeg4_packer *, uint8_t *, size_t *)) {
    uint8_t payload[RTP_ROOM];
    size_t at = 0, size;
    int bad = 0;
    while (next(packer, payload, &size)) {
        CHECK(size <= RTP_ROOM - (at ? 0 : RTP_FIRST_LESS));
        CHECK(!memcmp(payload, frame.data + at, size));
        bad += !may_begin(at);
        CHECK(may_begin(at) == mpeg4_is_start(payload, size) || !may_begin(at));
        at += size;
    }
    CHECK_EQUAL(at, frame.bits / 8);
    return bad;
}

static bool ours(struct mpeg4_packer *packer, uint8_t *to, size_t *size) {
    bool last = false;
    *size = mpeg4_pack_next(packer, to, &last);
    CHECK(!*size || last == (packer->at == packer->end));
    return *size;
}

/* Cuts where the packet is full, like libavformat. */
static bool blind(struct mpeg4_packer *packer, uint8_t *to, size_t *size) {
    size_t room = RTP_ROOM - RTP_FIRST_LESS;
    *size = (size_t)(packer->end - packer->at) < room ? (size_t)(packer->end - packer->at) : room;
    memcpy(to, packer->at, *size);
    packer->at += *size;
    return *size;
}

static void begin_frame(void) {
    frame.bits = 0;
    frame.starts = 0;
    frame.start[frame.starts++] = 0;
}

static void test_begins(void) {
    static const unsigned resolutions[] = {1, 2, 25, 30, 90, 1000, 30000, 65535};
    static const unsigned time_bits[] = {1, 1, 5, 5, 7, 10, 15, 16};
    int blind_ones = 0;
    for (int round = 0; round < 400; round++) {
        struct mpeg4_packer packer = {0};
        int which = round % 8;
        begin_frame();
        vol(resolutions[which], round % 3, round % 3 == 2);
        vop(false, 0, time_bits[which], 1, 8, RTP_ROOM * 3 / 4);
        mpeg4_pack(&packer, frame.data, frame.bits / 8);
        CHECK_EQUAL(bad_begins(&packer, ours), 0);
        for (unsigned fcode = 1; fcode <= 7; fcode++) { /* the following frames have no VOL header */
            begin_frame();
            vop(true, fcode, time_bits[which], fcode % 3, 8, RTP_ROOM * 3 / 4);
            mpeg4_pack(&packer, frame.data, frame.bits / 8);
            CHECK_EQUAL(bad_begins(&packer, ours), 0);
            mpeg4_pack(&packer, frame.data, frame.bits / 8);
            blind_ones += bad_begins(&packer, blind);
        }
    }
    CHECK(blind_ones > 1000); /* the check can fail */
}

/* A video packet that does not fit is sent in fragments; the next one begins a payload again. */
static void test_too_large(void) {
    struct mpeg4_packer packer = {0};
    begin_frame();
    vol(25, false, false);
    vop(false, 0, 5, 0, 5, 4 * RTP_ROOM);
    mpeg4_pack(&packer, frame.data, frame.bits / 8);
    int bad = bad_begins(&packer, ours);
    CHECK(bad > 0 && bad <= 5 * 4);
}

/* After a gap, everything up to the next start is left out. */
static void test_gaps(void) {
    struct mpeg4_packer packer = {0};
    uint8_t payload[50][RTP_ROOM];
    size_t size[50], total = 0;
    int count = 0;
    bool last;
    begin_frame();
    vol(25, false, false);
    vop(false, 0, 5, 0, 6, 3 * RTP_ROOM);
    mpeg4_pack(&packer, frame.data, frame.bits / 8);
    while (count < 50 && (size[count] = mpeg4_pack_next(&packer, payload[count], &last)))
        total += size[count++];
    CHECK(count > 6);
    for (int missing = -1; missing < count; missing++) {
        struct mpeg4_unpacker unpacker = {0};
        struct chunk whole = {0};
        size_t left_out = missing < 0 ? 0 : size[missing];
        for (int i = 0; i < count; i++)
            if (i != missing)
                CHECK(mpeg4_unpack(&unpacker, &whole, payload[i], size[i], i && i - 1 == missing));
        for (int i = missing + 1; missing >= 0 && i < count && !mpeg4_is_start(payload[i], size[i]); i++)
            left_out += size[i];
        CHECK_EQUAL(whole.size, total - left_out);
        chunk_free(&whole);
    }
}

static void test_headers(void) {
    begin_frame();
    vol(25, true, true);
    size_t headers = frame.bits / 8;
    vop(false, 0, 5, 0, 2, 100);
    CHECK_EQUAL(mpeg4_headers(frame.data, frame.bits / 8), headers);
    CHECK_EQUAL(mpeg4_headers(frame.data, headers + 3), 0);
    begin_frame();
    vop(false, 0, 5, 0, 2, 100);
    CHECK_EQUAL(mpeg4_headers(frame.data, frame.bits / 8), 0);
}

/* Sizes are known before decoding, for each form of the header, and wherever it is cut off. */
static void test_sizes(void) {
    static const uint8_t studio[] = {0, 0, 1, 0xb0, 0xe4, 0}, simple[] = {0, 0, 1, 0xb0, 0x01, 0};
    struct mpeg4_vol found;
    const uint8_t *at;
    for (int round = 0; round < 12; round++) {
        begin_frame();
        fixed_bits = round % 2 ? 5 : 0;
        vol(25, round % 3, round % 3 == 2);
        vol(25, round % 4 > 1, false);
        vop(false, 0, 5, 0, 2, 100);
        at = frame.data;
        const uint8_t *end = frame.data + frame.bits / 8;
        for (int i = 0; i < 2; i++) {
            CHECK(mpeg4_next_vol(&at, end, &found));
            CHECK_EQUAL(found.width, WIDTH);
            CHECK_EQUAL(found.height, HEIGHT);
            CHECK_EQUAL(found.time_bits, 5);
        }
        CHECK(!mpeg4_next_vol(&at, end, &found));
        for (const uint8_t *cut = frame.data; cut < end; cut++)
            for (at = frame.data; mpeg4_next_vol(&at, cut, &found);)
                CHECK(at <= cut && found.width <= WIDTH && found.height <= HEIGHT);
    }
    fixed_bits = 0;
    CHECK(mpeg4_is_studio(studio, sizeof studio) && !mpeg4_is_studio(simple, sizeof simple));
    CHECK(!mpeg4_is_studio(studio, 4) && !mpeg4_is_studio(studio, 0));
}

int main(void) {
    test_sizes();
    test_begins();
    test_too_large();
    test_gaps();
    test_headers();
    return 0;
}
