/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Sender and receivers of a repaired stream in one process, on a virtual clock. */
#ifndef REPAIR_SIM_H
#define REPAIR_SIM_H

#include <errno.h>

#include "stream_rx.h"
#include "stream_tx.h"

#include "bits.h"

#include "lossy.h"

#define FRAMES 2000
#define CALM 25 /* the first frames, which are not counted */
#define INTERVAL (40 * MS)
#define IN_TIME (100 * MS)
#define RECEIVERS 4
#define WIRE 250000
#define SSRC 0x1001u
#define HEADER 28
#define MOST 64          /* packets of a frame */
#define WAVE 22          /* frames that renew the picture, column by column */
#define WAVES 100        /* frames from one renewal to the next */
#define LEVEL 25         /* frames */
#define LEAST_LEVEL 0.48 /* of the limit; the real clip of bench/loss.py is 3 dB worse then (docs/bench.md) */

static struct frame {
    int64_t written;
    unsigned packets;  /* 0: dropped before it was encoded */
    unsigned number;   /* in the stream, which leaves out dropped ones */
    double level;      /* bytes of a frame, the mean of the last ones */
    unsigned renewing; /* the frame at which the newest renewal of the picture began, */
    unsigned renewed;  /* and the newest one that is complete with this frame */
    uint8_t last;      /* byte */
} frames[FRAMES];

static struct receiver {
    struct stream_rx rx;
    struct loser down, up, both;
    struct lossy from, to; /* the sender */
    bool usable[FRAMES];
    unsigned next;   /* the first frame that has not come out */
    bool refresh;    /* the picture is broken */
    unsigned broken; /* pictures are whole again with a renewal that began at this frame or later */
} receivers[RECEIVERS];

struct run {
    const char *name;
    enum loss loss;
    double part;
    int64_t trip; /* round trip, ns */
    unsigned receivers;
    int64_t wire;     /* bit/s; 0: WIRE */
    int64_t video;    /* limit in bit/s; 0: the default */
    bool silent;      /* no reports */
    double ratio;     /* of repair packets to media packets without reports; 0: STREAM_TX_RATIO if silent */
    double smaller;   /* part of the allowance by which frames are smaller, as x264's are */
    bool any_size;    /* frames of less than LEAST_LEVEL count as well, as they do without reports */
    unsigned begin;   /* frame from which on packets are lost */
    bool old;         /* the receivers do not know probes */
    unsigned hush;    /* frame from which on no report arrives, 0: never */
    unsigned forgers; /* that claim to miss much */
    unsigned forged;  /* frames from one forged repair packet to the next; 0: none */
    unsigned garbage; /* datagrams to the sender with each frame */
};

static struct stream_tx tx;
static int64_t now, start;
static uint64_t wire[FRAMES * 4 + 400]; /* bytes of each 10 ms */
static uint16_t sequence;
static unsigned frame_count;
static uint64_t video_bytes, repair_bytes_sent;
static bool renewal; /* a receiver has asked for one */

static int64_t wire_of(const struct run *run) {
    return run->wire ? run->wire : WIRE;
}

/* ---- Sender ---- */

/* A NAL unit of its own, since the receiver takes encoded frames out of the packets. */
static size_t make_packet(uint8_t *to, unsigned frame, unsigned number, size_t payload, bool first, bool last) {
    const struct rtp_packet packet = {
        .type = RTP_H264,
        .marker = last,
        .sequence = sequence++,
        .time = frame * 3600,
        .ssrc = SSRC,
        .has_count = true,
        .has_source = first,
        .frame = {.count = (uint16_t)number, .window = REPAIR_FRAMES, .sequence = frame, .number = frame}};
    uint8_t *at = to + rtp_write(to, &packet);

    *at = 0x41;
    memset(at + 1, (int)(frame ^ payload), payload - 1);
    return (size_t)(at - to) + payload;
}

/* As x264 does: a renewal takes WAVE frames, and the next one begins after it. */
static void renew(struct frame *frame) {
    const struct frame *before = frame_count ? frame - 1 : NULL;
    unsigned since = before ? frame_count - before->renewing : 0;

    frame->renewing = before ? before->renewing : 0;
    frame->renewed = before && since < WAVE ? before->renewed : frame->renewing;
    if (since >= WAVE && (renewal || since >= WAVES)) {
        frame->renewing = frame_count;
        renewal = false;
    }
}

/* Equal packets; one packet for a frame of up to 800 bytes. */
static void write_frame(const struct run *run) {
    static uint8_t data[MOST][RTP_PACKET_MAX];
    struct stream_tx_packet packets[MOST];
    struct frame *frame = &frames[frame_count];
    size_t allowed = stream_tx_allowance(&tx, now);
    size_t whole = 0;
    bool wants = allowed && stream_tx_wants_refresh(&tx, now, &whole);
    allowed = whole > allowed ? whole : allowed;
    size_t size = frame_count ? (size_t)((double)allowed * (1 - run->smaller) * (0.7 + 0.6 * random_share())) : 4000;
    unsigned count = !allowed ? 0 : size <= 800 ? 1 : size <= 1160 ? 2 : (unsigned)(size + 1159) / 1160;

    *frame = (struct frame){.written = now, .packets = count};
    frame->number = frame_count ? frame[-1].number + (count > 0) : 0;
    renewal |= wants && !whole;
    renew(frame);
    if (whole)
        frame->renewing = frame->renewed = frame_count;
    for (unsigned i = 0; i < count; i++) {
        packets[i].data = data[i];
        size_t part = size * (i + 1) / count - size * i / count;
        packets[i].size = make_packet(data[i], frame_count, frame->number, part, !i, i + 1 == count);
        frame->last = data[i][packets[i].size - 1];
    }
    double before = frame_count ? frame[-1].level : (double)size;
    frame->level = before + ((count ? (double)size : 0) - before) / LEVEL;
    if (count)
        stream_tx_packets(&tx, now, (uint16_t)frame->number, packets, count);
    video_bytes += frame_count < CALM ? 0 : count ? size : 0;
    frame_count++;
}

static void send_due(const struct run *run) {
    uint8_t data[REPAIR_MAX];
    enum stream_tx_port port;
    size_t size;

    while (stream_tx_next(&tx, now, data, &size, &port)) {
        wire[(now - start) / (10 * MS)] += size + HEADER;
        repair_bytes_sent += port == STREAM_TX_REPAIR ? size + HEADER : 0;
        for (unsigned i = 0; i < run->receivers; i++)
            lossy_send(&receivers[i].from, now, port, data, size);
    }
    CHECK(stream_tx_deadline(&tx, now) > now);
}

static void forge(const struct run *run) {
    uint8_t data[REPORT_MAX] = {0};

    for (unsigned i = 0; i < run->forgers; i++) {
        struct report report = {.reporter = i,
                                .media = SSRC,
                                .has_state = true,
                                .highest = (uint16_t)(sequence - 1),
                                .base = (uint16_t)(sequence - 200),
                                .missing = 199,
                                .loss = i & 1 ? 250 : 0};
        stream_tx_report(&tx, now, data, report_write(data, &report), 666);
    }
    for (unsigned i = 0; i < run->garbage; i++) {
        data[i % REPORT_MAX] = (uint8_t)(i * 77);
        stream_tx_report(&tx, now, data, i % (REPORT_MAX + 1), i);
    }
}

/* ---- Receivers ---- */

static bool shows(struct receiver *receiver, unsigned frame) {
    if (frames[frame].renewing >= receiver->broken)
        receiver->refresh = false;
    return frames[frame].renewed >= receiver->broken;
}

/* A frame comes out after all frames before it, or after those that were given up: then pictures are broken until one
 * is renewed. */
static void got_frame(struct receiver *receiver, const struct assembly_frame *got) {
    unsigned frame = receiver->next;

    while (frame < frame_count && (!frames[frame].packets || (uint16_t)frames[frame].number != got->frame.count))
        frame++;
    CHECK(frame < frame_count && (!got->has_source || got->derived || got->frame.number == frame));
    CHECK(got->incomplete || got->data[got->size - 1] == frames[frame].last);
    if (got->damaged || (got->first && frame)) {
        receiver->broken = frame + got->incomplete;
        receiver->refresh = true;
    }
    receiver->next = frame + 1;
    receiver->usable[frame] = shows(receiver, frame) && !got->incomplete && now - frames[frame].written <= IN_TIME;
}

static void got_datagram(const struct run *run, struct receiver *receiver, const struct lossy_packet *packet) {
    struct assembly_frame frame;

    if (packet->port == STREAM_TX_MEDIA)
        stream_rx_put(&receiver->rx, packet->data, packet->size, now);
    else if (!run->old || packet->size != REPAIR_HEADER)
        stream_rx_put_repair(&receiver->rx, packet->data, packet->size, now);
    while (stream_rx_take(&receiver->rx, now, &frame))
        got_frame(receiver, &frame);
}

/* A repair packet as far ahead as a receiver accepts it, which no sender has sent. */
static void receive_forged(struct receiver *receiver) {
    uint8_t data[REPAIR_HEADER + 600] = {0x81, REPAIR_TYPE};
    uint16_t first = (uint16_t)(receiver->rx.restore.came + RESTORE_AHEAD - 3);

    put16(data + 2, 12345);
    put32(data + 12, SSRC);
    put16(data + 18, 0xf000 | 4);
    put32(data + 20, first);
    memset(data + REPAIR_HEADER, 0x55, sizeof data - REPAIR_HEADER);
    CHECK(stream_rx_put_repair(&receiver->rx, data, sizeof data, now) || !receiver->rx.followed);
}

static void receive_due(const struct run *run, struct receiver *receiver) {
    const struct lossy_packet *packet;
    struct assembly_frame frame;
    uint8_t data[REPORT_MAX];
    size_t size;

    while ((packet = lossy_take(&receiver->from, now)))
        got_datagram(run, receiver, packet);
    while (stream_rx_take(&receiver->rx, now, &frame)) /* what has waited long enough */
        got_frame(receiver, &frame);
    while ((size = stream_rx_report(&receiver->rx, now, receiver->refresh, data)))
        lossy_send(&receiver->to, now, 0, data, size);
    CHECK(stream_rx_report_deadline(&receiver->rx) > now && stream_rx_deadline(&receiver->rx) > now);
    while ((packet = lossy_take(&receiver->to, now)))
        if (!run->hush || frame_count < run->hush)
            stream_tx_report(&tx, now, packet->data, packet->size, (uint64_t)(receiver - receivers));
}

/* ---- A run ---- */

static void begin(const struct run *run, uint64_t seed) {
    struct stream_tx_settings settings = {.wire = wire_of(run),
                                          .video = run->video,
                                          .interval = INTERVAL,
                                          .header = HEADER,
                                          .repair = true,
                                          .ratio = run->ratio > 0 ? run->ratio
                                                   : run->silent  ? STREAM_TX_RATIO
                                                                  : 0,
                                          .media_ssrc = SSRC,
                                          .repair_ssrc = 2,
                                          .repair_sequence = 65000};

    random_begin(seed);
    now = start = 1000 * MS;
    sequence = 65000; /* both wrap soon */
    frame_count = 0;
    video_bytes = repair_bytes_sent = 0;
    renewal = false;
    memset(wire, 0, sizeof wire);
    stream_tx_init(&tx, &settings, now);
    for (unsigned i = 0; i < run->receivers; i++) {
        struct receiver *receiver = &receivers[i];

        const struct stream_rx_settings receives = {
            .patience = IN_TIME, .repairs = true, .reports = !run->silent, .ssrc = 100 + i};

        stream_rx_free(&receiver->rx);
        memset(receiver, 0, sizeof *receiver);
        stream_rx_init(&receiver->rx, &receives);
        receiver->rx.report_header = HEADER;
        receiver->down.loss = receiver->up.loss = receiver->both.loss = run->loss;
        receiver->down.change = receiver->up.change = receiver->both.change = now;
        receiver->down.random = random_seed(1000 * seed + 3 * i);
        receiver->up.random = random_seed(1000 * seed + 3 * i + 1);
        receiver->both.random = random_seed(1000 * seed + 3 * i + 2);
        receiver->from.loser = run->loss == OUTAGES_TOGETHER ? &receiver->both : &receiver->down;
        receiver->to.loser = run->loss == OUTAGES_TOGETHER ? &receiver->both : &receiver->up;
        receiver->from.delay = receiver->to.delay = run->trip / 2;
    }
}

static int64_t next_event(const struct run *run) {
    int64_t time = frame_count < FRAMES ? start + frame_count * INTERVAL : start + FRAMES * INTERVAL + 200 * MS;

    for (unsigned i = 0; i < run->receivers; i++) {
        const struct receiver *receiver = &receivers[i];
        const int64_t times[] = {lossy_next(&receiver->from), lossy_next(&receiver->to),
                                 stream_rx_deadline(&receiver->rx), stream_rx_report_deadline(&receiver->rx)};
        for (unsigned j = 0; j < 4; j++)
            time = times[j] < time ? times[j] : time;
    }
    int64_t due = stream_tx_deadline(&tx, now);
    return due < time ? due : time;
}

/* Does what is due now; returns the time of the next event. */
static int64_t step(const struct run *run) {
    if (frame_count < FRAMES && now >= start + frame_count * INTERVAL) {
        bool lossy = frame_count >= run->begin;
        for (unsigned i = 0; i < run->receivers; i++)
            receivers[i].down.part = receivers[i].up.part = receivers[i].both.part = lossy ? run->part : 0;
        write_frame(run);
        send_due(run);
        forge(run);
        for (unsigned i = 0; run->forged && frame_count % run->forged == 0 && i < run->receivers; i++)
            receive_forged(&receivers[i]);
    }
    send_due(run);
    for (unsigned i = 0; i < run->receivers; i++)
        receive_due(run, &receivers[i]);
    send_due(run);
    int64_t next = next_event(run);
    CHECK(next > now);
    return next;
}

static void simulate(const struct run *run, uint64_t seed) {
    begin(run, seed);
    while (now < start + FRAMES * INTERVAL + 200 * MS)
        now = step(run);
}

/* ---- Results ---- */

/* Without loss the frames are as large as the limit. */
static bool looks_good(const struct run *run, unsigned frame) {
    int64_t clean = run->video ? run->video : wire_of(run) * 7 / 10;
    double least = LEAST_LEVEL * (double)(clean * INTERVAL / (1000 * MS)) / 8;

    return run->any_size || run->silent || frames[frame].level >= least;
}

/* Percent of usable frames, of the receiver that has the fewest. */
static double usable(const struct run *run, unsigned from, unsigned to) {
    double least = 100;

    for (unsigned i = 0; i < run->receivers; i++) {
        unsigned count = 0;
        for (unsigned frame = from; frame < to; frame++)
            count += receivers[i].usable[frame] && looks_good(run, frame);
        least = fmin(least, 100.0 * count / (to - from));
    }
    return least;
}

static double kbit(unsigned from, unsigned frames_after) {
    uint64_t bytes = 0;

    for (unsigned i = from * 4; i < (from + frames_after) * 4; i++)
        bytes += wire[i];
    return (double)bytes * 8 / (double)(frames_after * INTERVAL / MS);
}

/* The longest time without a usable frame, in s, of any receiver. */
static double longest_gap(const struct run *run) {
    unsigned longest = 0;

    for (unsigned i = 0; i < run->receivers; i++) {
        unsigned gap = 0;
        for (unsigned frame = CALM; frame < FRAMES; frame++) {
            gap = receivers[i].usable[frame] ? 0 : gap + 1;
            longest = gap > longest ? gap : longest;
        }
    }
    return longest * (double)INTERVAL / (1000 * (double)MS);
}

static double video_kbit(void) {
    return (double)video_bytes * 8 / (double)((FRAMES - CALM) * INTERVAL / MS);
}

static double peak(void) {
    double most = 0;

    for (unsigned frame = 0; frame + 25 <= FRAMES; frame++)
        most = fmax(most, kbit(frame, 25));
    return most;
}

static void check_books(const struct run *run) {
    const uint64_t *count = tx.count, *reports = tx.feedback.count;
    uint64_t sum = 0;

    CHECK_EQUAL(count[STREAM_TX_PACKETS], count[STREAM_TX_SENT] + count[STREAM_TX_DROPPED] + tx.waiting);
    CHECK_EQUAL(receivers[0].from.sent, count[STREAM_TX_SENT] + count[STREAM_TX_REPAIRS]);
    for (unsigned i = FEEDBACK_RECEIVED + 1; i < FEEDBACK_COUNTS; i++)
        sum += reports[i];
    CHECK_EQUAL(reports[FEEDBACK_RECEIVED], sum);
    CHECK(kbit(0, FRAMES) <= (double)wire_of(run) / 1000);
    CHECK(peak() <= 1.3 * (double)wire_of(run) / 1000);
    for (unsigned i = 0; i < run->receivers; i++)
        CHECK((double)receivers[i].to.sent * (REPORT_SIZE + HEADER) * 8 <= 60 * (double)(FRAMES * INTERVAL / MS));
}

#endif
