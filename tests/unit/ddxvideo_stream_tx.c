/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The sender's rules one by one: budget, order, invalid reports. ddxvideo_repair_sim.c measures their effect. */
#include "stream_tx.h"

#include <errno.h>

#include "bits.h"

#include "check.h"

#define MS INT64_C(1000000)
#define SSRC 7u
#define HEADER 28
#define INTERVAL (40 * MS)

static struct stream_tx tx;
static int64_t now;
static uint16_t sequence, frame;
static uint8_t loss; /* that reports contain */

static void begin(int64_t wire) {
    struct stream_tx_settings settings = {.wire = wire,
                                          .video = wire,
                                          .interval = INTERVAL,
                                          .header = HEADER,
                                          .repair = true,
                                          .media_ssrc = SSRC,
                                          .repair_ssrc = 8,
                                          .repair_sequence = 65535};

    now = 5000 * MS;
    sequence = 65534;
    frame = 0;
    stream_tx_init(&tx, &settings, now);
}

static void write_frame(unsigned count, size_t size) {
    static uint8_t data[300][RTP_PACKET_MAX];
    struct stream_tx_packet packets[300];

    for (unsigned i = 0; i < count; i++) {
        struct rtp_packet packet = {.type = RTP_H264, .marker = i + 1 == count, .sequence = sequence++, .ssrc = SSRC};
        rtp_write(data[i], &packet);
        packets[i] = (struct stream_tx_packet){data[i], size};
    }
    stream_tx_packets(&tx, now, frame++, packets, count);
}

/* How many packets are due now, on each port. */
static void expect(unsigned media, unsigned repairs) {
    uint8_t data[REPAIR_MAX];
    unsigned sent[2] = {0};
    enum stream_tx_port port;
    size_t size;

    while (stream_tx_next(&tx, now, data, &size, &port))
        sent[port]++;
    CHECK_EQUAL(sent[STREAM_TX_MEDIA], media);
    CHECK_EQUAL(sent[STREAM_TX_REPAIR], repairs);
    CHECK(stream_tx_deadline(&tx, now) > now);
}

/* Send all packets that are due within this time. */
static void run(int64_t time, unsigned media, unsigned repairs) {
    uint64_t media_before = tx.count[STREAM_TX_SENT], repairs_before = tx.count[STREAM_TX_REPAIRS];
    int64_t end = now + time, next;
    uint8_t data[REPAIR_MAX];
    enum stream_tx_port port;
    size_t size;

    for (; now <= end; now = next) {
        while (stream_tx_next(&tx, now, data, &size, &port))
            ;
        next = stream_tx_deadline(&tx, now);
        CHECK(next > now);
    }
    now = end;
    CHECK_EQUAL(tx.count[STREAM_TX_SENT] - media_before, media);
    CHECK_EQUAL(tx.count[STREAM_TX_REPAIRS] - repairs_before, repairs);
}

static void report_as(uint32_t reporter, uint64_t address, uint16_t highest, uint16_t base, uint16_t missing,
                      int64_t age, enum feedback_count expected) {
    struct report report = {.reporter = reporter,
                            .media = SSRC,
                            .has_state = true,
                            .highest = highest,
                            .base = base,
                            .missing = missing,
                            .age = age,
                            .loss = loss};
    uint64_t before = tx.feedback.count[expected];
    uint8_t data[REPORT_MAX];

    stream_tx_report(&tx, now, data, report_write(data, &report), address);
    CHECK_EQUAL(tx.feedback.count[expected] - before, 1);
}

static void report(uint16_t highest, uint16_t base, uint16_t missing, int64_t age) {
    report_as(1, 1, highest, base, missing, age, FEEDBACK_USED);
}

/* An encoded frame: a NAL unit of this size. */
static bool write_encoded(size_t size) {
    static uint8_t data[400000] = {0, 0, 0, 1, 0x41};
    struct rtp_packet packet = {.type = RTP_H264, .time = frame * 3600u, .frame = {.count = frame}};

    CHECK(size + 4 <= sizeof data);
    memset(data + 5, 1, size - 1);
    frame++;
    return stream_tx_frame(&tx, now, packet, data, size + 4);
}

/* Sends all that is due within a second; returns the number of media packets, and the numbers of the first and the last
 * one. */
static unsigned send_media(uint16_t *first, uint16_t *last) {
    unsigned count = 0;
    uint8_t data[REPAIR_MAX];
    enum stream_tx_port port;
    struct rtp_packet packet;
    size_t size;

    for (int64_t end = now + 1000 * MS; now < end; now += MS / 4)
        while (stream_tx_next(&tx, now, data, &size, &port)) {
            if (port != STREAM_TX_MEDIA)
                continue;
            CHECK(rtp_parse(data, size, &packet) && packet.ssrc == SSRC && packet.has_count);
            *first = count ? *first : packet.sequence;
            CHECK(!count || packet.sequence == (uint16_t)(*last + 1));
            CHECK(packet.has_source == !count);
            *last = packet.sequence;
            count++;
        }
    CHECK(!count || packet.marker);
    return count;
}

/* Frames become packets with consecutive numbers. A frame that has no room leaves a gap in them, and no packet; one of
 * more packets than the queue ever holds leaves no gap. */
static void check_frames(void) {
    uint16_t first, last = 0, before;

    begin(100000000);
    tx.sequence = 65530;
    CHECK(write_encoded(500));
    CHECK_EQUAL(send_media(&first, &last), 1);
    CHECK_EQUAL(first, 65530);
    CHECK(write_encoded(12000));
    CHECK_EQUAL(send_media(&first, &last), 11);
    CHECK_EQUAL(first, 65531);
    CHECK_EQUAL(last, 5);
    CHECK(!write_encoded(STREAM_TX_QUEUE * RTP_ROOM));
    CHECK_EQUAL(tx.waiting, 0);
    CHECK(write_encoded(200000));
    unsigned waiting = tx.waiting;
    CHECK(!write_encoded(200000));
    CHECK_EQUAL(tx.waiting, waiting);
    CHECK_EQUAL(send_media(&first, &last), waiting);
    CHECK_EQUAL(first, 6);
    before = last;
    CHECK(write_encoded(500));
    CHECK_EQUAL(send_media(&first, &last), 1);
    CHECK_EQUAL(first, (uint16_t)(before + 1 + waiting));
    CHECK_EQUAL(tx.count[STREAM_TX_PACKETS], tx.count[STREAM_TX_SENT]);
}

/* The first three packets at once, so that a frame of usual size does not wait; the others within half an interval, at
 * most 1 ms apart. */
static void check_pacing(void) {
    begin(10000000);
    write_frame(1, 100);
    expect(1, 0);
    now += INTERVAL;
    write_frame(40, 1000);
    expect(3, 0);
    run(INTERVAL / 2, 37, 0);
    now += INTERVAL;
    write_frame(3, 1000);
    expect(3, 0);
    CHECK_EQUAL(stream_tx_deadline(&tx, now), INT64_MAX);
    now += INTERVAL;
    write_frame(5, 1000);
    expect(3, 0);
    run(2 * MS, 2, 0);
    CHECK_EQUAL(stream_tx_deadline(&tx, now), INT64_MAX);
}

/* A frame after a waiting one also sends three packets at once, and no more. */
static void check_burst_of_waiting_frames(void) {
    begin(10000000);
    write_frame(5, 1000);
    expect(3, 0);
    write_frame(5, 1000);
    now += MS;
    expect(3, 0);
    run(4 * MS, 4, 0);
}

static void check_queue(void) {
    begin(10000000);
    write_frame(STREAM_TX_QUEUE + 5, 100);
    write_frame(1, RTP_PACKET_MAX + 1);
    CHECK_EQUAL(tx.count[STREAM_TX_DROPPED], 6);
    run(1000 * MS, STREAM_TX_QUEUE, 0);
    CHECK_EQUAL(tx.count[STREAM_TX_PACKETS], STREAM_TX_QUEUE + 6);
}

/* Packets beyond the budget wait, and until then no other frame is accepted. */
static void check_budget(void) {
    begin(80000);
    CHECK(stream_tx_allowance(&tx, now) > 0);
    write_frame(20, 1000);
    run(INTERVAL, 1, 0); /* half the bucket is 1500 bytes */
    CHECK_EQUAL(stream_tx_allowance(&tx, now), 0);
    CHECK(!stream_tx_other(&tx, now, 1000));
    run(2100 * MS, 19, 0); /* 20,560 bytes are 2,056 ms, and half the bucket was there */
    CHECK_EQUAL(tx.count[STREAM_TX_BYTES], 20 * (1000 + HEADER));
    run(1000 * MS, 0, 0);
    CHECK(stream_tx_other(&tx, now, 1000 + HEADER));
    CHECK_EQUAL(tx.count[STREAM_TX_BYTES], 21 * (1000 + HEADER));
    CHECK_EQUAL(tx.count[STREAM_TX_OTHERS], 1);
    CHECK_EQUAL(tx.count[STREAM_TX_OTHERS_LOST], 1);
}

/* A sending thread that comes late, on a busy machine, costs no frame: what waits is due, and sent at once. */
static void check_late_thread(void) {
    begin(10000000);
    write_frame(10, 1000);
    now += INTERVAL;
    CHECK(stream_tx_allowance(&tx, now) > 0);
    expect(3, 0);
}

/* Frames leave room for other packets: first the size announced in advance, then the real one. */
static void check_others(void) {
    begin(400000);
    size_t alone = stream_tx_allowance(&tx, now);
    tx.settings.others = 1;
    CHECK(stream_tx_allowance(&tx, now) < alone * 6 / 10);
    for (int i = 0; i < 250; i++, now += INTERVAL) {
        size_t allowed = stream_tx_allowance(&tx, now);
        CHECK(allowed > 0);
        write_frame(1, allowed);
        expect(1, 0);
        CHECK(stream_tx_other(&tx, now, 2 * allowed));
    }
    CHECK_EQUAL(tx.count[STREAM_TX_OTHERS], 250);
    CHECK(tx.count[STREAM_TX_BYTES] <= 400000 / 8 * 10);
}

/* Three packets across the wrap, round trip 5 ms; the last one is lost, then its repair packet as well. */
static void check_answer(void) {
    begin(1000000);
    write_frame(1, 500);
    run(INTERVAL, 1, 0);
    write_frame(1, 500);
    run(5 * MS, 1, 0);
    report(65535, 0, 0, 0);
    run(35 * MS, 0, 0);
    write_frame(1, 500);
    run(5 * MS, 1, 0);
    report(65535, 0, 0, 40 * MS); /* the last packet is in flight */
    expect(0, 0);
    now += 10 * MS;
    report(65535, 0, 0, 50 * MS);
    expect(0, 1);
    now += 5 * MS;
    report(65535, 0, 0, 55 * MS); /* the repair packet is in flight */
    expect(0, 0);
    now += 50 * MS;
    loss = 77;
    report(65535, 0, 0, 105 * MS); /* it is lost as well, and 70 ms have passed: with a loss of 30 % two are needed */
    run(5 * MS, 0, 2);
    loss = 0;
}

/* In an outage only probes are sent; all that is missing follows when a probe has arrived. */
static void check_outage(void) {
    uint8_t data[REPAIR_MAX];
    enum stream_tx_port port;
    size_t size;

    begin(1000000);
    write_frame(1, 500);
    run(5 * MS, 1, 0);
    report(65534, 65535, 0, 0);
    write_frame(8, 500);
    run(20 * MS, 8, 0);
    report(65534, 65535, 0, 20 * MS);
    for (unsigned i = 0; i < 4; i++, now += MS) {
        CHECK(stream_tx_next(&tx, now, data, &size, &port));
        CHECK(port == STREAM_TX_REPAIR && size == REPAIR_HEADER);
    }
    expect(0, 0);
    CHECK(tx.feedback.reporter[0].deficit.needed == 8);
    now += 5 * MS;
    struct report arrived = {.reporter = 1,
                             .media = SSRC,
                             .has_state = true,
                             .highest = 65534,
                             .base = 65535,
                             .has_repair = true,
                             .highest_repair = 1};
    stream_tx_report(&tx, now, data, report_write(data, &arrived), 1);
    uint64_t bytes = tx.count[STREAM_TX_BYTES];
    run(20 * MS, 0, 8);
    CHECK(tx.count[STREAM_TX_BYTES] - bytes >= 8 * 500);
}

static void check_reports_that_do_not_count(void) {
    begin(1000000);
    report_as(1, 1, 0, 1, 0, 0, FEEDBACK_GARBAGE); /* nothing was sent */
    write_frame(1, 500);
    write_frame(1, 500);
    run(INTERVAL, 2, 0);
    report_as(1, 1, 65535, 0, 0, 41 * MS, FEEDBACK_GARBAGE); /* received before it was sent */
    report_as(1, 1, 200, 201, 0, 0, FEEDBACK_STALE);         /* never sent */
    report_as(1, 1, 65535, 0, 0, REPORT_OLDEST_NS, FEEDBACK_STALE);
    report_as(1, 1, 65535, 0, 0, 20 * MS, FEEDBACK_USED);
    report_as(1, 1, 65535, 65535, 1, 10 * MS, FEEDBACK_STALE); /* older than the one before */
    expect(0, 0);
    tx.feedback.media++;
    report_as(1, 1, 65535, 65535, 1, 30 * MS, FEEDBACK_GARBAGE); /* of another stream */
}

static void check_reporters(void) {
    begin(1000000);
    write_frame(1, 500);
    run(INTERVAL, 1, 0);
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
        report_as(i, 1, 65534, 65535, 0, 0, FEEDBACK_USED);
    report_as(100, 1, 65534, 65535, 0, 0, FEEDBACK_FLOOD); /* the same address once more */
    report_as(100, 2, 65534, 65535, 0, 0, FEEDBACK_USED);  /* replaces a reporter that shares its address */
    report_as(101, 2, 65534, 65535, 0, 0, FEEDBACK_FLOOD);
    for (unsigned i = 0; i < 99; i++) /* 200 a second, 100 at once */
        report_as(100, 2, 65534, 65535, 0, 0, FEEDBACK_USED);
    report_as(100, 2, 65534, 65535, 0, 0, FEEDBACK_USED);
    report_as(100, 2, 65534, 65535, 0, 0, FEEDBACK_FLOOD);
    now += FEEDBACK_GONE_NS;
    report_as(101, 2, 65534, 65535, 0, 0, FEEDBACK_USED); /* the others have left */
}

/* Eight reporters of other hosts that lose nothing: after ten seconds a ninth one gets a place, if it lacks packets. */
static void check_calm_reporters(void) {
    begin(1000000);
    write_frame(1, 500);
    run(INTERVAL, 1, 0);
    for (int64_t until = now + FEEDBACK_CALM_NS; now < until;) {
        write_frame(1, 500);
        now += INTERVAL;
        expect(1, 0);
        for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
            report_as(i, i, (uint16_t)(sequence - 1), sequence, 0, 0, FEEDBACK_USED);
        report_as(100, 100, (uint16_t)(sequence - 1), (uint16_t)(sequence - 1), 1, 0, FEEDBACK_FLOOD);
    }
    now += INTERVAL;
    for (unsigned i = 0; i < FEEDBACK_REPORTERS; i++)
        report_as(i, i, (uint16_t)(sequence - 1), sequence, 0, INTERVAL, FEEDBACK_USED);
    report_as(100, 100, (uint16_t)(sequence - 1), sequence, 0, INTERVAL, FEEDBACK_FLOOD);
    report_as(100, 100, (uint16_t)(sequence - 1), (uint16_t)(sequence - 1), 1, INTERVAL, FEEDBACK_USED);
    expect(0, 1);
}

/* A forged repair packet lets an honest receiver report packets that were never sent: the others still count. */
static void check_reports_beyond_the_newest_packet(void) {
    struct report report = {
        .reporter = 1, .media = SSRC, .has_state = true, .has_repair = true, .highest_repair = 12345};
    uint8_t data[REPORT_MAX];

    begin(1000000);
    write_frame(3, 500);
    run(INTERVAL, 3, 0);
    report.base = (uint16_t)(sequence - 1); /* the last one is missing, and 128 more */
    report.highest = (uint16_t)(sequence - 1 + REPORT_AHEAD);
    report.missing = REPORT_AHEAD + 1;
    stream_tx_report(&tx, now, data, report_write(data, &report), 1);
    CHECK_EQUAL(tx.feedback.count[FEEDBACK_USED], 1);
    expect(0, 1);
}

/* Frames of one packet, each of which arrives at once; with or without a report. */
static void pass_frames(unsigned count, bool reported) {
    uint8_t data[REPAIR_MAX];
    enum stream_tx_port port;
    size_t size;

    for (unsigned i = 0; i < count; i++, now += INTERVAL) {
        write_frame(1, 500);
        for (int64_t until = now + INTERVAL / 2; now < until; now += MS)
            while (stream_tx_next(&tx, now, data, &size, &port))
                ;
        if (reported)
            report((uint16_t)(sequence - 1), sequence, 0, INTERVAL / 2);
        now -= INTERVAL / 2;
    }
}

/* A receiver that needs nothing does not stop repair in advance: neither that of -repair, nor for another one that had
 * losses when its reports stopped. */
static void check_advance_beside_calm_reporters(void) {
    begin(1000000);
    tx.settings.ratio = 1;
    pass_frames(50, true);
    CHECK(tx.count[STREAM_TX_REPAIRS] >= 50);

    begin(1000000);
    loss = 77;
    write_frame(1, 500);
    run(INTERVAL / 2, 1, 0);
    report_as(2, 2, (uint16_t)(sequence - 1), sequence, 0, INTERVAL / 2, FEEDBACK_USED);
    loss = 0;
    pass_frames(50, true);
    uint64_t before = tx.count[STREAM_TX_REPAIRS];
    pass_frames(50, true);
    CHECK(tx.count[STREAM_TX_REPAIRS] - before >= 60); /* for a loss of 30 % */
}

/* Repair without reports follows the loss of the last ten seconds, not only of the last two. */
static void check_loss_memory(void) {
    begin(1000000);
    loss = 77; /* 30 % */
    pass_frames(500, true);
    loss = 8;
    pass_frames(1, true);
    now += FEEDBACK_GONE_NS;
    uint64_t before = tx.count[STREAM_TX_REPAIRS];
    pass_frames(40, false);
    uint64_t repairs = tx.count[STREAM_TX_REPAIRS] - before;
    CHECK(repairs >= 73 && repairs <= 75); /* 0.35 + 5 * 0.3 for each, and one more for each 64 */
    loss = 0;
}

/* A whole picture at most each four seconds; in between, renewals. */
static void check_refresh(void) {
    struct report report = {.reporter = 1, .media = SSRC, .refresh = true};
    uint8_t data[REPORT_MAX];
    size_t size = report_write(data, &report), whole;

    begin(1000000);
    CHECK(!stream_tx_wants_refresh(&tx, now, &whole));
    for (int i = 0; i < 9; i++) {
        stream_tx_report(&tx, now, data, size, 1);
        stream_tx_report(&tx, now, data, size, 2);
        CHECK(stream_tx_wants_refresh(&tx, now, &whole) && (whole > 0) == (i % 4 == 0));
        CHECK(whole <= (size_t)budget_tokens(&tx.budget, now) / 2);
        stream_tx_report(&tx, now, data, size, 1);
        now += 999 * MS;
        CHECK(!stream_tx_wants_refresh(&tx, now, &whole));
        now += MS;
    }
}

/* Renewals within a minute that no receiver has asked for: fewer at a loss, but not with receivers without repair. */
static unsigned count_renewals(int64_t renewal, uint8_t lost, double others) {
    unsigned count = 0;
    size_t whole;

    begin(1000000);
    tx.settings.renewal = renewal;
    tx.settings.others = others;
    loss = lost;
    for (int64_t end = now + 60000 * MS; now < end;) {
        write_frame(1, 200);
        run(INTERVAL, 1, 0);
        report((uint16_t)(sequence - 1), sequence, 0, MS);
        if (stream_tx_wants_refresh(&tx, now, &whole)) {
            CHECK_EQUAL(whole, 0);
            count++;
        }
    }
    loss = 0;
    return count;
}

static void check_renewals(void) {
    CHECK_EQUAL(count_renewals(4000 * MS, 0, 0), 15);
    CHECK_EQUAL(count_renewals(4000 * MS, 77, 0), 3);
    CHECK_EQUAL(count_renewals(4000 * MS, 77, 0.5), 15);
    CHECK_EQUAL(count_renewals(0, 0, 0), 0);
}

/* A clock that goes back adds no bytes. */
static void check_clock(void) {
    struct budget budget;

    budget_init(&budget, 80000, 300 * MS, 1, now);
    CHECK_EQUAL(budget_size(&budget), 3000);
    CHECK(budget_take(&budget, now, 3000) && !budget_take(&budget, now, 1));
    CHECK(!budget_take(&budget, now - 1000 * MS, 1));
    CHECK_EQUAL(budget_tokens(&budget, now - 1000 * MS), 0);
    CHECK_EQUAL(budget_ready(&budget, 1000), now + 100 * MS);
    CHECK(!budget_take(&budget, now + 100 * MS - 1, 1000) && budget_take(&budget, now + 100 * MS, 1000));
    CHECK_EQUAL(budget_ready(&budget, 3001), INT64_MAX);
}

int main(void) {
    check_frames();
    check_pacing();
    check_burst_of_waiting_frames();
    check_queue();
    check_budget();
    check_late_thread();
    check_others();
    check_answer();
    check_outage();
    check_reports_that_do_not_count();
    check_reporters();
    check_calm_reporters();
    check_advance_beside_calm_reporters();
    check_reports_beyond_the_newest_packet();
    check_loss_memory();
    check_refresh();
    check_renewals();
    check_clock();
    return 0;
}
