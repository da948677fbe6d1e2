/* SPDX-License-Identifier: GPL-2.0-or-later */
/* H.264 payloads by the rules of RFC 6184, from frame to packets and back, with and without loss. */
#include "payload.h"

#include "check.h"
#include "rtp.h"

#define FU (RTP_ROOM - 2) /* bytes of a NAL unit that a fragment has, at most */
#define NALS_MAX 40
#define PAYLOADS_MAX 200

struct payload {
    size_t size;
    uint8_t data[RTP_ROOM];
    bool last;
    int first_nal, last_nal; /* of the frame's NAL units, which of them are in it, at least in part */
};

static struct payload payloads[PAYLOADS_MAX];
static struct chunk nals[NALS_MAX];
static unsigned seed = 1;

static unsigned next_random(void) {
    seed = seed * 1664525u + 1013904223u;
    return seed >> 8;
}

/* A NAL unit without start codes in it: no zero bytes. */
static void make_nal(struct chunk *nal, size_t size) {
    static const uint8_t heads[] = {0x67, 0x68, 0x06, 0x65, 0x41, 0x01};
    nal->size = 0;
    CHECK(chunk_add(nal, NULL, size));
    for (size_t i = 0; i < size; i++)
        nal->data[i] = (uint8_t)(1 + next_random() % 255);
    nal->data[0] = heads[next_random() % sizeof(heads)];
}

static void join(struct chunk *frame, int count, bool short_codes) {
    static const uint8_t code[] = {0, 0, 0, 1};
    frame->size = 0;
    for (int i = 0; i < count; i++) {
        bool shorter = short_codes && i % 2;
        CHECK(chunk_add(frame, code + shorter, sizeof(code) - shorter));
        CHECK(chunk_add(frame, nals[i].data, nals[i].size));
    }
}

static int pack(const struct chunk *frame) {
    struct h264_packer packer;
    int count = 0;
    h264_pack(&packer, frame->data, frame->size);
    for (; count < PAYLOADS_MAX; count++) {
        struct payload *payload = &payloads[count];
        payload->last = false;
        payload->size = h264_pack_next(&packer, payload->data, &payload->last);
        if (!payload->size)
            break;
    }
    return count;
}

/* Size of the whole packet. */
static size_t packet_size(int number) {
    return payloads[number].size + (number ? RTP_HEADER_NEXT : RTP_HEADER_MAX);
}

/* Whether packets first to last, fragments of one NAL unit, are equal in size and as few as possible. */
static bool are_even(int first, int last) {
    size_t least = SIZE_MAX, most = 0, all = 0;
    for (int i = first; i <= last; i++) {
        least = packet_size(i) < least ? packet_size(i) : least;
        most = packet_size(i) > most ? packet_size(i) : most;
        all += payloads[i].size;
    }
    size_t fewer = (size_t)(last - first) * (RTP_ROOM - 2) - (first ? 0 : RTP_FIRST_LESS);
    bool needed = last - first == 1 || all - 2 * (size_t)(last - first + 1) > fewer;
    return most - least <= 1 && needed;
}

/* NULL if the payloads carry exactly these NAL units, by the rules; else the rule that is broken. */
static const char *judge(int count, int nal_count) {
    int nal = 0, begin = 0;
    size_t inside = 0; /* bytes of the present NAL unit that came in fragments */
    for (int i = 0; i < count; i++) {
        struct payload *payload = &payloads[i];
        uint8_t type = payload->data[0] & 31, importance = 0;
        payload->first_nal = nal;
        if (nal >= nal_count)
            return "payload beyond the frame";
        if (packet_size(i) > RTP_PACKET_MAX)
            return "too large";
        if (payload->last != (i == count - 1))
            return "marker";
        if (inside && type != H264_FU_A)
            return "fragments are interrupted";
        if (type == H264_FU_A) {
            uint8_t position = payload->data[1] >> 6;
            if (payload->data[1] & 0x20 || position == 3)
                return "5.8: R is 0, S and E are not both set";
            if ((position == 2) != !inside)
                return "5.8: S at the first fragment only";
            if (((payload->data[0] & 0xe0) | (payload->data[1] & 31)) != nals[nal].data[0])
                return "5.8: F, NRI and type of the NAL unit";
            if (nals[nal].size <= RTP_WHOLE)
                return "a small NAL unit in fragments";
            begin = inside ? begin : i;
            inside += !inside;
            if (inside + payload->size - 2 > nals[nal].size ||
                memcmp(payload->data + 2, nals[nal].data + inside, payload->size - 2))
                return "other bytes";
            inside += payload->size - 2;
            if ((inside == nals[nal].size) != (position == 1))
                return "5.8: E at the last fragment only";
            payload->last_nal = nal;
            if (position == 1 && !are_even(begin, i))
                return "fragments of other sizes";
            if (position == 1) {
                nal++;
                inside = 0;
            }
            continue;
        }
        if (type != H264_STAP_A) {
            if (payload->size != nals[nal].size || memcmp(payload->data, nals[nal].data, payload->size))
                return "5.6: a NAL unit as it is";
            payload->last_nal = nal++;
            continue;
        }
        size_t at = 1;
        while (at < payload->size && nal < nal_count) {
            size_t size = (size_t)(payload->data[at] << 8 | payload->data[at + 1]);
            if (size != nals[nal].size || at + 2 + size > payload->size ||
                memcmp(payload->data + at + 2, nals[nal].data, size))
                return "5.7.1: size and NAL unit";
            if ((nals[nal].data[0] & 0x60) > importance)
                importance = nals[nal].data[0] & 0x60;
            at += 2 + size;
            nal++;
        }
        if (at != payload->size || nal - payload->first_nal < 2)
            return "5.7: two or more NAL units, nothing after them";
        if ((payload->data[0] & 0x60) != importance)
            return "5.7: NRI is the highest of them";
        payload->last_nal = nal - 1;
    }
    return nal == nal_count && !inside ? NULL : "NAL units are missing";
}

/* Unpack all payloads but `missing` (-1: none); only the whole NAL units come out. */
static void check_unpacked(int count, int nal_count, int missing) {
    struct h264_unpacker unpacker = {0};
    struct chunk frame = {0}, expected = {0};
    static const uint8_t code[] = {0, 0, 0, 1};
    for (int i = 0; i < count; i++)
        if (i != missing)
            CHECK(h264_unpack(&unpacker, &frame, payloads[i].data, payloads[i].size, i && i - 1 == missing));
    h264_unpack_end(&unpacker, &frame);
    for (int i = 0; i < nal_count; i++) {
        if (missing >= 0 && i >= payloads[missing].first_nal && i <= payloads[missing].last_nal)
            continue;
        CHECK(chunk_add(&expected, code, sizeof(code)) && chunk_add(&expected, nals[i].data, nals[i].size));
    }
    CHECK_EQUAL(frame.size, expected.size);
    CHECK(!frame.size || !memcmp(frame.data, expected.data, frame.size));
    chunk_free(&frame);
    chunk_free(&expected);
}

static void test_frames(void) {
    static const size_t sizes[] = {1,
                                   2,
                                   5,
                                   30,
                                   500,
                                   RTP_WHOLE - 6,
                                   RTP_WHOLE - 5,
                                   RTP_WHOLE - 1,
                                   RTP_WHOLE,
                                   RTP_WHOLE + 1,
                                   RTP_ROOM,
                                   2 * FU - RTP_FIRST_LESS,
                                   2 * FU - RTP_FIRST_LESS + 1,
                                   2 * FU - RTP_FIRST_LESS + 2,
                                   2 * FU + 1,
                                   2 * FU + 2,
                                   5000,
                                   70000};
    struct chunk frame = {0};
    for (int round = 0; round < 300; round++) {
        int count = 1 + (int)(next_random() % 12);
        for (int i = 0; i < count; i++)
            make_nal(&nals[i], sizes[next_random() % (sizeof(sizes) / sizeof(*sizes) - (round % 10 != 0))]);
        join(&frame, count, round % 2);
        int packets = pack(&frame);
        const char *broken = judge(packets, count);
        if (frame.size <= RTP_WHOLE && packets != 1)
            broken = "a small frame is one packet";
        if (broken)
            fprintf(stderr, "round %d: %s\n", round, broken);
        CHECK(!broken);
        for (int missing = -1; missing < packets; missing++)
            check_unpacked(packets, count, missing);
    }
    chunk_free(&frame);
}

/* Move two bytes of the second fragment to the first one: the same bytes in packets of other sizes. */
static void move_byte(void) {
    struct payload *from = &payloads[2], *to = &payloads[1];
    memcpy(to->data + to->size, from->data + 2, 2);
    memmove(from->data + 2, from->data + 4, from->size - 4);
    to->size += 2;
    from->size -= 2;
}

/* The judge finds each fault. */
static void test_judge(void) {
    struct chunk frame = {0};
    make_nal(&nals[0], 20);
    make_nal(&nals[1], 10);
    nals[0].data[0] = 0x67;
    nals[1].data[0] = 0x41;
    make_nal(&nals[2], 3000);
    join(&frame, 3, false);
    int count = pack(&frame);
    CHECK_EQUAL(count, 4); /* STAP-A, three fragments */
    CHECK(!judge(count, 3));
#define CHECK_RED(change)                     \
    do {                                      \
        struct payload kept[4];               \
        memcpy(kept, payloads, sizeof(kept)); \
        change;                               \
        CHECK(judge(count, 3));               \
        memcpy(payloads, kept, sizeof(kept)); \
        CHECK(!judge(count, 3));              \
    } while (0)
    CHECK_RED(payloads[0].data[0] = 0x38);  /* NRI too low */
    CHECK_RED(payloads[0].data[2]++);       /* size in the aggregate */
    CHECK_RED(payloads[0].size++);          /* a byte more */
    CHECK_RED(payloads[1].data[1] ^= 0x80); /* no S */
    CHECK_RED(payloads[2].data[1] |= 0x40); /* E too early */
    CHECK_RED(payloads[3].data[1] ^= 0x40); /* no E */
    CHECK_RED(payloads[3].data[9] ^= 1);    /* another byte */
    CHECK_RED(payloads[2] = payloads[3]);   /* a fragment missing */
    CHECK_RED(payloads[3].last = false);    /* no marker */
    CHECK_RED(move_byte());                 /* fragments of other sizes */
    chunk_free(&frame);
}

static void test_malformed(void) {
    static const uint8_t bad[][6] = {{0},
                                     {24},
                                     {24, 0},
                                     {24, 0, 0},
                                     {24, 0, 9, 1},
                                     {24, 0, 1, 0x41, 0},
                                     {25, 0, 0, 0, 1, 0x41},
                                     {28},
                                     {28, 0x81},
                                     {29, 0x81, 0, 0, 1},
                                     {30, 1},
                                     {31, 1}};
    static const size_t sizes[] = {1, 1, 2, 3, 4, 5, 6, 1, 2, 5, 2, 2};
    for (size_t i = 0; i < sizeof(sizes) / sizeof(*sizes); i++) {
        struct h264_unpacker unpacker = {0};
        struct chunk frame = {0};
        CHECK(!h264_unpack(&unpacker, &frame, bad[i], sizes[i], false));
        chunk_free(&frame);
    }
    struct h264_unpacker unpacker = {0};
    struct chunk frame = {0};
    CHECK(!h264_unpack(&unpacker, &frame, bad[0], 0, false));
}

/* The encoder's output: sometimes parameter sets, and one slice. */
static void test_one_slice(void) {
    struct chunk frame = {0};
    for (size_t size = 2; size < 6000; size += size < 1500 ? 1 : 37)
        for (int sets = 0; sets <= 2; sets += 2) {
            make_nal(&nals[0], 25);
            make_nal(&nals[1], 5);
            make_nal(&nals[sets], size);
            join(&frame, sets + 1, false);
            int packets = pack(&frame);
            const char *broken = judge(packets, sets + 1);
            if (broken)
                fprintf(stderr, "%d and a slice of %zu bytes: %s\n", sets, size, broken);
            CHECK(!broken && (packets == 1 || frame.size > RTP_WHOLE));
        }
    chunk_free(&frame);
}

int main(void) {
    test_one_slice();
    test_frames();
    test_judge();
    test_malformed();
    for (int i = 0; i < NALS_MAX; i++)
        chunk_free(&nals[i]);
    return 0;
}
