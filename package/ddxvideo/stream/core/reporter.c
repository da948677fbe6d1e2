/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "reporter.h"

#include "ddx_time.h"

#define REPORTS_BITS 59000   /* bit/s */
#define BUCKET_NS (320 * MS) /* 39 reports */
#define REPORTS_KEPT 1       /* reports that must be left after one without an arrival, for the next arrival */
#define REPORTS_SPARE 5      /* reports that must be left after a repetition */
#define JITTER_NS (4 * MS)   /* jitter after which a packet is late */
#define FIRST_INTERVAL_NS (40 * MS)
#define STAMP_JUMP_NS (10000 * MS) /* a time stamp further away begins again */
#define REPAIR_JUMP_PACKETS 64     /* packets lost in sequence, after which a repair packet needs the next one */
#define RUN_PACKETS_MOST 16        /* packets; a longer run is an outage */
#define SLOT_NS (500 * MS)

void reporter_init(struct reporter *reporter, uint32_t ssrc, uint32_t media_ssrc, size_t header, int64_t now) {
    *reporter = (struct reporter){
        .ssrc = ssrc, .media_ssrc = media_ssrc, .header = header, .interval = FIRST_INTERVAL_NS, .slot_begin = now};
    budget_init(&reporter->budget, REPORTS_BITS, BUCKET_NS, 1, now);
}

/* ---- Arrivals ---- */

static void rotate_slots(struct reporter *reporter, int64_t now) {
    for (unsigned turns = 0; now - reporter->slot_begin >= SLOT_NS && turns < REPORTER_SLOTS; turns++) {
        for (unsigned i = REPORTER_SLOTS - 1; i; i--) {
            reporter->expected[i] = reporter->expected[i - 1];
            reporter->received[i] = reporter->received[i - 1];
        }
        reporter->expected[0] = reporter->received[0] = 0;
        reporter->slot_begin += SLOT_NS;
    }
    if (now - reporter->slot_begin >= SLOT_NS)
        reporter->slot_begin = now;
}

/* `step`: from the newest number so far to this one. */
static void count_expected(struct reporter *reporter, unsigned step) {
    reporter->expected[0] += step;
    if (step > 1)
        reporter->run_mean += ((step <= RUN_PACKETS_MOST ? step - 1 : RUN_PACKETS_MOST) - reporter->run_mean) / 8;
}

static void note_arrival(struct reporter *reporter, struct reporter_stream *stream, int64_t now, uint16_t sequence) {
    rotate_slots(reporter, now);
    reporter->received[0]++;
    if (!stream->begun)
        reporter->expected[0]++;
    else if (rtp_after(sequence, stream->highest))
        count_expected(reporter, (uint16_t)(sequence - stream->highest));
    if (!stream->begun || rtp_after(sequence, stream->highest))
        stream->highest = sequence;
    stream->begun = true;
    reporter->arrived = now;
    reporter->fresh = true;
}

/* Learns the arrival times of frames; only the first packet of each has a new time stamp. The offset follows early
 * arrivals at once and late ones slowly. So does the interval: after a loss it appears longer. */
static void learn_frame(struct reporter *reporter, int64_t now, uint32_t time) {
    int64_t step = (int64_t)(int32_t)(time - reporter->time) * 100000 / 9;
    int64_t offset = now - reporter->stamp - step;

    if (step <= 0 && step > -STAMP_JUMP_NS)
        return;
    if (step < STAMP_JUMP_NS && step > 0) {
        reporter->interval = step < reporter->interval ? step : reporter->interval + (step - reporter->interval) / 16;
        reporter->offset = offset < reporter->offset ? offset : reporter->offset + (offset - reporter->offset) / 64;
    } else {
        reporter->offset = offset;
    }
    reporter->stamp += step;
    reporter->time = time;
}

void reporter_media(struct reporter *reporter, int64_t now, uint16_t sequence, uint32_t time, bool marker) {
    if (!reporter->media.begun) {
        reporter->time = time;
        reporter->stamp = 0;
        reporter->offset = now;
    }
    learn_frame(reporter, now, time);
    if (!reporter->media.begun || rtp_after(sequence, reporter->media.highest))
        reporter->open = !marker;
    note_arrival(reporter, &reporter->media, now, sequence);
}

/* A number that does not fit may be forged, or the last one was: it counts when the next packet confirms it. */
void reporter_repair(struct reporter *reporter, int64_t now, uint16_t sequence) {
    struct reporter_stream *stream = &reporter->repair;
    int ahead = (int16_t)(sequence - stream->highest);

    if (stream->begun && (ahead <= 0 || ahead > REPAIR_JUMP_PACKETS)) {
        if (!rtp_is_confirmed(&reporter->stranger, sequence))
            return;
        stream->highest = (uint16_t)(sequence - 1);
    }
    reporter->stranger.there = false;
    note_arrival(reporter, &reporter->repair, now, sequence);
}

/* ---- Reports ---- */

static uint8_t loss_of(const struct reporter *reporter) {
    unsigned expected = 0, received = 0;

    for (unsigned i = 0; i < REPORTER_SLOTS; i++) {
        expected += reporter->expected[i];
        received += reporter->received[i];
    }
    return received >= expected ? 0 : (uint8_t)((expected - received) * 255u / expected);
}

unsigned reporter_loss(const struct reporter *reporter) {
    return loss_of(reporter) * 100u / 255u;
}

int64_t reporter_deadline(const struct reporter *reporter, const struct restore *restore) {
    int64_t due = reporter->offset + reporter->stamp + reporter->interval + JITTER_NS, time;
    int64_t repeat = reporter->reported + REPORTER_REPEAT_NS;
    size_t bytes = reporter->header + (reporter->refresh ? REPORT_MAX : REPORT_SIZE);
    uint16_t base, highest;
    unsigned missing;

    if (!reporter->media.begun || !restore_missing(restore, &missing, &base, &highest))
        return INT64_MAX;
    if (reporter->open && highest == reporter->media.highest)
        due = reporter->arrived + JITTER_NS;
    time = missing || due < repeat ? repeat : due;
    if (reporter->fresh) {
        time = reporter->arrived;
    } else if (reporter->again && repeat < time &&
               budget_ready(&reporter->budget, (1 + REPORTS_SPARE) * bytes) < time) {
        time = repeat;
        bytes *= 1 + REPORTS_SPARE;
    } else {
        bytes *= 1 + REPORTS_KEPT;
    }
    if (!reporter->fresh && time > reporter->arrived + REPORTER_QUIET_NS)
        return INT64_MAX;
    int64_t ready = budget_ready(&reporter->budget, bytes);
    return ready > time ? ready : time;
}

size_t reporter_next(struct reporter *reporter, int64_t now, const struct restore *restore, uint8_t *to) {
    struct report report = {.reporter = reporter->ssrc,
                            .media = reporter->media_ssrc,
                            .has_state = true,
                            .has_repair = reporter->repair.begun,
                            .highest_repair = reporter->repair.highest,
                            .age = now - reporter->arrived,
                            .refresh = reporter->refresh};
    unsigned missing;

    if (now < reporter_deadline(reporter, restore))
        return 0;
    restore_missing(restore, &missing, &report.base, &report.highest);
    rotate_slots(reporter, now);
    report.missing = (uint16_t)missing;
    report.loss = loss_of(reporter);
    size_t size = report_write(to, &report);
    if (!budget_take(&reporter->budget, now, reporter->header + size))
        return 0;
    reporter->again = reporter->fresh;
    reporter->fresh = false;
    reporter->reported = now;
    return size;
}
