/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: RTCP reports into a running sender. The input is a sequence of commands, each a byte: its low three bits
 * are the command, the others a number n. Bytes of the input follow where noted. After each command all packets that
 * are due are sent.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "stream_tx.h"

#define MS INT64_C(1000000)
#define SECOND INT64_C(1000000000)
#define SSRC 0x1001u
#define REPAIR_SSRC 0x2002u
#define WIRE 250000
#define HEADER 28
#define MOST 1000 /* packets sent at once: more would be an endless loop */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum command {
    FRAME,  /* a frame of n % 8 + 1 packets; (1 byte) their size */
    WAIT,   /* n + 1 ms */
    PAUSE,  /* n * 100 ms */
    REPORT, /* a possible report of reporter n & 7 at address n >> 3: (6 bytes) see make_report() */
    CHANGE, /* the same, but the byte at (1 byte) is changed (1 byte) */
    DATA,   /* (1 byte) size, (size bytes) a datagram from address n */
    ROOM,   /* the sender asks for the size of the next frame */
    REFRESH /* the sender asks whether a receiver needs a renewal */
};

struct input {
    const uint8_t *at, *end;
};

static struct stream_tx tx;
static int64_t begin, now;
static uint16_t sequence, frame;

static uint8_t take_byte(struct input *input) {
    return input->at < input->end ? *input->at++ : 0;
}

/* A report that report_parse() accepts is the same when it is written again. */
static void write_again(const uint8_t *data, size_t size) {
    uint8_t first[REPORT_MAX], second[REPORT_MAX];
    struct report report, same;

    if (report_parse(data, size, &report))
        return;
    size_t written = report_write(first, &report);
    assert(written && !report_parse(first, written, &same));
    assert(report_write(second, &same) == written && !memcmp(first, second, written));
}

/* Delivers the datagram from memory of exactly its size. */
static void deliver(const uint8_t *data, size_t size, uint64_t address) {
    uint8_t *copy = malloc(size ? size : 1);

    memcpy(copy, data, size);
    write_again(copy, size);
    stream_tx_report(&tx, now, copy, size, address);
    free(copy);
}

static size_t make_report(struct input *input, unsigned n, uint8_t *to) {
    uint16_t newest = (uint16_t)tx.feedback.sent.newest, repairs = (uint16_t)tx.feedback.repairs.newest;
    struct report report = {.reporter = n & 7, .media = SSRC, .has_state = true};

    report.highest = (uint16_t)(newest - take_byte(input));
    report.base = (uint16_t)(report.highest + 1 - take_byte(input));
    report.missing = take_byte(input);
    report.loss = take_byte(input);
    report.age = take_byte(input) * MS;
    uint8_t back = take_byte(input);
    report.has_repair = back & 1;
    report.highest_repair = (uint16_t)(repairs - back / 2);
    report.refresh = back & 2;
    return report_write(to, &report);
}

static void send_report(struct input *input, unsigned n, bool change) {
    uint8_t data[REPORT_MAX];
    size_t size = make_report(input, n, data);

    if (change) {
        size_t at = take_byte(input) % size;
        data[at] = take_byte(input);
    }
    deliver(data, size, n >> 3);
}

static void send_data(struct input *input, unsigned n) {
    size_t size = take_byte(input);

    if (size > (size_t)(input->end - input->at))
        size = (size_t)(input->end - input->at);
    deliver(input->at, size, n);
    input->at += size;
}

static void write_frame(struct input *input, unsigned n) {
    static uint8_t data[8][RTP_PACKET_MAX];
    struct stream_tx_packet packets[8];
    unsigned count = n % 8 + 1;
    size_t more = take_byte(input) * 4u;

    for (unsigned i = 0; i < count; i++) {
        struct rtp_packet packet = {.type = RTP_H264, .marker = i + 1 == count, .sequence = sequence++, .ssrc = SSRC};
        packets[i] = (struct stream_tx_packet){data[i], rtp_write(data[i], &packet) + 1 + more};
    }
    stream_tx_packets(&tx, now, frame++, packets, count);
}

/* A repair packet covers packets that were sent, up to the newest one. */
static void check_repair(const uint8_t *data, size_t size) {
    struct repair_packet repair;

    assert(repair_parse(data, size, &repair) && repair.media_ssrc == SSRC && repair.ssrc == REPAIR_SSRC);
    assert(repair.count <= tx.window.count && repair.first + repair.count - 1 == tx.window.newest);
}

static void send_all(void) {
    uint8_t packet[REPAIR_MAX];
    enum stream_tx_port port;
    size_t size;

    for (unsigned count = 0; stream_tx_next(&tx, now, packet, &size, &port); count++) {
        assert(count < MOST && size <= (port == STREAM_TX_MEDIA ? RTP_PACKET_MAX : REPAIR_MAX));
        if (port == STREAM_TX_REPAIR)
            check_repair(packet, size);
    }
    assert(stream_tx_deadline(&tx, now) > now);
}

/* With any reports, the rate is kept, and each packet and each report is counted. */
static void check_counts(void) {
    const uint64_t *count = tx.count, *reports = tx.feedback.count;
    uint64_t allowed = (uint64_t)(WIRE / 8 * (0.3 + (double)(now - begin) / SECOND)) + 1;

    assert(count[STREAM_TX_BYTES] <= allowed);
    assert(count[STREAM_TX_PACKETS] == count[STREAM_TX_SENT] + count[STREAM_TX_DROPPED] + tx.waiting);
    assert(reports[FEEDBACK_RECEIVED] ==
           reports[FEEDBACK_USED] + reports[FEEDBACK_GARBAGE] + reports[FEEDBACK_STALE] + reports[FEEDBACK_FLOOD]);
}

static void step(struct input *input) {
    uint8_t byte = take_byte(input);
    unsigned n = byte >> 3;

    switch ((enum command)(byte & 7)) {
    case FRAME: write_frame(input, n); break;
    case WAIT: now += (n + 1) * MS; break;
    case PAUSE: now += n * 100 * MS; break;
    case REPORT: send_report(input, n, false); break;
    case CHANGE: send_report(input, n, true); break;
    case DATA: send_data(input, n); break;
    case ROOM: assert(stream_tx_allowance(&tx, now) <= WIRE / 8); break;
    case REFRESH: stream_tx_wants_refresh(&tx, now, &(size_t){0}); break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const struct stream_tx_settings settings = {.wire = WIRE,
                                                .video = WIRE,
                                                .interval = 40 * MS,
                                                .header = HEADER,
                                                .repair = true,
                                                .ratio = STREAM_TX_RATIO,
                                                .media_ssrc = SSRC,
                                                .repair_ssrc = REPAIR_SSRC,
                                                .repair_sequence = 65530};
    struct input input = {data, data + size};

    begin = now = 5000 * MS;
    sequence = 65530;
    frame = 65533;
    memset(&tx, 0xa5, sizeof tx); /* an input must always have the same effect */
    stream_tx_init(&tx, &settings, now);
    while (input.at < input.end) {
        step(&input);
        send_all();
        check_counts();
    }
    return 0;
}
