/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Sender and receivers in one process, on a virtual clock: 2,000 frames of 40 ms for each pattern of losses. Each
 * direction has losses of its own, from the first packet on; the first second is not counted. A frame is usable if it
 * and all frames before it have arrived 100 ms after it was passed to the sender.
 * Where the video has a limit, the picture must not be 3 dB worse than at that limit, judged by the mean size of the
 * last frames. The sizes of frames follow the allowance, up to 30 % more or less.
 */
#include "repair_sim.h"

#define VIDEO 130000 /* bit/s at most, as in bench/loss.py */

/* A sanitizer looks at memory and not at figures: one seed is enough, and no mean is judged. */
#ifndef SANITIZED
#define SANITIZED 0
#endif
#define SEEDS(count) (SANITIZED ? 1u : (count))

/* The mean of four seeds, with both round trip times. */
static void expect(struct run run, double figure, double least_video) {
    const unsigned seeds = SEEDS(4);
    double sum = 0, video = 0, mean = 0, most = 0, gap = 0;

    for (unsigned i = 0; i < seeds; i++) {
        run.trip = i % 2 ? 4 * MS : 10 * MS;
        run.receivers = run.receivers ? run.receivers : 1;
        simulate(&run, 1 + i);
        check_books(&run);
        double part = usable(&run, CALM, FRAMES);
        sum += part / seeds;
        video += video_kbit() / seeds;
        mean += kbit(0, FRAMES) / seeds;
        most = fmax(most, peak());
        gap = fmax(gap, longest_gap(&run));
        printf("%s%.2f", i ? ", " : run.name, part);
    }
    printf(": usable %.2f %% of %g, longest gap %.1f s, video %.0f, wire %.1f, at most %.1f kbit/s\n", sum, figure, gap,
           video, mean, most);
    if (!SANITIZED) /* one seed may have more losses than the mean */
        CHECK(sum >= figure && video >= least_video);
}

/* Loss begins at frame 1000: half a second later, frames are usable again. */
static void check_sudden(void) {
    struct run run = {.loss = INDEPENDENT, .part = 0.3, .trip = 10 * MS, .receivers = 1, .begin = 1000};

    for (uint64_t seed = 1; seed <= SEEDS(3); seed++) {
        simulate(&run, seed);
        check_books(&run);
        CHECK(usable(&run, CALM, 1000) == 100);
        printf("loss from 0 to 30 %% at once: usable from 0.5 s to 2.5 s later %.2f %%\n", usable(&run, 1013, 1063));
        CHECK(usable(&run, 1013, 1063) >= 98);
    }
}

/* Reports stop at frame 1000: at first less is sent, after a second as much as before, with repair in advance. The
 * mean of eight seeds, because the rate within half a second depends on earlier losses. */
static void check_hush(void) {
    struct run run = {
        .loss = INDEPENDENT, .part = 0.3, .trip = 10 * MS, .receivers = 1, .hush = 1000, .any_size = true};
    const unsigned seeds = SEEDS(8);
    double less = 0, later = 0;

    for (uint64_t seed = 1; seed <= seeds; seed++) {
        simulate(&run, seed);
        check_books(&run);
        less += kbit(1009, 12) / seeds;
        CHECK(kbit(1050, 100) > 0.95 * WIRE / 1000);
        later += usable(&run, 1050, FRAMES) / seeds;
    }
    printf("reports stop: %.0f kbit/s, then %.0f, %.0f; usable after 2 s %.2f %%\n", kbit(975, 25), less,
           kbit(1050, 100), later);
    CHECK(SANITIZED || (less < 0.9 * WIRE / 1000 && later >= 98));
}

/* The receiver reports bursts of losses until frame 1000: then repair in advance is enough for bursts. */
static void check_hush_in_bursts(void) {
    struct run run = {.loss = BURSTS, .part = 0.3, .trip = 10 * MS, .receivers = 1, .hush = 1000, .any_size = true};
    const unsigned seeds = SEEDS(8);
    double later = 0;

    for (uint64_t seed = 1; seed <= seeds; seed++) {
        simulate(&run, seed);
        check_books(&run);
        later += usable(&run, 1050, FRAMES) / seeds;
    }
    printf("reports of bursts stop: usable after 2 s %.2f %%\n", later);
    CHECK(SANITIZED || later >= 87);
}

/* Forged reports leave enough rate for the honest receiver; garbage has no effect. */
static void check_forged(void) {
    struct run run = {
        .loss = INDEPENDENT, .part = 0.3, .trip = 10 * MS, .receivers = 1, .forgers = 20, .any_size = true};

    simulate(&run, 1);
    check_books(&run);
    printf("forged reports: usable %.2f %%, video %.0f kbit/s\n", usable(&run, CALM, FRAMES), video_kbit());
    CHECK(usable(&run, CALM, FRAMES) >= 97);
    CHECK(video_kbit() >= 60);
    CHECK(tx.feedback.count[FEEDBACK_FLOOD] > 1000);

    run.forgers = 0;
    simulate(&run, 1);
    double before = usable(&run, CALM, FRAMES);
    uint64_t bytes = video_bytes;
    run.garbage = 400; /* 10,000 a second */
    simulate(&run, 1);
    check_books(&run);
    CHECK(usable(&run, CALM, FRAMES) == before && video_bytes == bytes);
    CHECK_EQUAL(tx.feedback.count[FEEDBACK_GARBAGE], 400 * FRAMES);
}

/* Repair that is wanted and refused, though half of the bucket or more is unused: ns. */
static int64_t refused(int64_t until) {
    const struct deficit *deficit = &tx.feedback.reporter[0].deficit;
    struct stream_tx copy = tx; /* asking changes nothing that counts */
    uint32_t first;

    if (!copy.feedback.reporter[0].used || !deficit->wanted || now - deficit->heard >= FEEDBACK_GONE_NS ||
        feedback_wanted(&copy.feedback, now, &first) ||
        budget_tokens(&copy.budget, now) < budget_size(&copy.budget) / 2)
        return 0;
    return until - now;
}

/* Outages at different times in the two directions: the picture freezes hardly longer than the outage, and repair does
 * not wait while there is rate for it. */
static void check_freeze(void) {
    const struct run run = {.loss = OUTAGES, .part = 0.3, .trip = 4 * MS, .receivers = 1, .video = VIDEO};
    const unsigned seeds = SEEDS(4);
    double part = 0, gap = 0;
    int64_t waits = 0;

    for (uint64_t seed = 1; seed <= seeds; seed++) {
        begin(&run, seed);
        while (now < start + FRAMES * INTERVAL + 200 * MS) {
            int64_t next = step(&run);
            waits += refused(next);
            now = next;
        }
        part += usable(&run, CALM, FRAMES) / seeds;
        gap = fmax(gap, longest_gap(&run));
    }
    printf("outages: usable %.1f %%, longest gap %.1f s, repair refused for %.1f s\n", part, gap,
           (double)waits / 1e9 / seeds);
    CHECK(SANITIZED || (part >= 89.5 && gap <= 1 && waits < 4000 * MS));
}

/* Percent of the time since the first second in which the picture is older than 0.25 s, of the first receiver; the
 * number of changes of the frame rate. */
static double frozen(const struct run *run, uint64_t seed, unsigned *changes) {
    int64_t written = start, old = 0;
    unsigned next = 0, every = 1;

    begin(run, seed);
    while (now < start + FRAMES * INTERVAL) {
        int64_t then = step(run);

        for (; next < receivers[0].next; next++)
            if (frames[next].packets && frames[next].renewed >= receivers[0].broken)
                written = frames[next].written;
        *changes += tx.frames.every != every;
        every = tx.frames.every;
        int64_t from = written + 250 * MS;
        if (now >= start + CALM * INTERVAL && then > from)
            old += then - (now > from ? now : from);
        now = then;
    }
    check_books(run);
    return 100.0 * (double)old / (double)((FRAMES - CALM) * INTERVAL);
}

/* Where half of the packets are lost, or the wire is small, there is no rate for all frames and their repair: frames
 * are smaller and fewer, but pictures do not freeze. When the losses are over, all frames are sent again. */
static void check_small_wire(void) {
    static const struct {
        double part;
        int64_t wire;
        unsigned receivers;
        double frozen; /* percent at most */
    } cases[] = {
        {0.5, 400000, 1, 3}, {0.5, 250000, 1, 3}, {0.5, 80000, 1, 12}, {0.3, 50000, 1, 1}, {0.5, 250000, 4, 4}};

    const unsigned seeds = SEEDS(4);

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct run run = {.loss = INDEPENDENT,
                                .part = cases[i].part,
                                .trip = 4 * MS,
                                .receivers = cases[i].receivers,
                                .wire = cases[i].wire};
        double part = 0;
        unsigned changes = 0;

        for (unsigned seed = 1; seed <= seeds; seed++)
            part += frozen(&run, seed, &changes) / seeds;
        printf(
            "wire %.0f kbit/s, loss %.0f %%, %u receivers: frozen for %.1f %% of %g, frame rate changed %.1f times\n",
            (double)run.wire / 1000, 100 * run.part, run.receivers, part, cases[i].frozen, (double)changes / seeds);
        if (!SANITIZED) /* one seed may have more losses than the mean */
            CHECK(part <= cases[i].frozen);
        CHECK(changes <= 20 * seeds); /* 80 s */
    }
    struct run run = {.loss = INDEPENDENT, .part = 0.5, .trip = 4 * MS, .receivers = 1, .wire = 80000};
    unsigned fewer = 0, left_out = 0;

    begin(&run, 1);
    for (; now < start + FRAMES * INTERVAL; now = step(&run))
        run.part = frame_count < FRAMES / 2 ? 0.5 : 0;
    for (unsigned i = FRAMES / 4; i < FRAMES; i++)
        *(i < FRAMES / 2 ? &fewer : i > FRAMES / 2 + 250 ? &left_out : &run.begin) += !frames[i].packets;
    printf("losses are over: %u of %u frames left out, 10 s later %u\n", fewer, FRAMES / 4, left_out);
    CHECK(fewer >= FRAMES / 10 && left_out <= 5);
}

/* The lies of a reporter: nothing has come; nothing comes any more; nearly everything is lost; all is late; nothing has
 * come, and half is lost. */
enum lie { MISSES, OUTAGE, HOPELESS, DELAY, HALF, LIES };

static void lie(enum lie lie) {
    unsigned known = tx.window.count < 199 ? tx.window.count : 199, back = lie == OUTAGE ? known / 2 : 0;
    uint16_t highest = (uint16_t)(sequence - 1 - back);
    struct report report = {.reporter = 5,
                            .media = SSRC,
                            .has_state = true,
                            .highest = highest,
                            .base = (uint16_t)(sequence - known),
                            .loss = lie == HOPELESS ? 250
                                    : lie == HALF   ? 128
                                                    : 0};
    const struct history *sent = &tx.feedback.sent;
    uint8_t data[REPORT_MAX];

    if (known < 4)
        return;
    report.missing = (uint16_t)(known - back - 1);
    if (lie == DELAY) {
        report.missing = 0;
        report.highest = (uint16_t)(frame_count < CALM ? highest : highest - 3);
        report.base = (uint16_t)(report.highest + 1);
    }
    if (back)
        report.age = (now - history_sent(sent, history_find(sent, highest)) - 2 * MS) / REPORT_TICK_NS * REPORT_TICK_NS;
    stream_tx_report(&tx, now, data, report_write(data, &report), 666);
}

/* A lone reporter that lies 200 times a second, while the receivers that watch do not report: repair takes at most half
 * of the rate, and the video goes on. */
static void check_hostile(void) {
    struct run run = {.loss = INDEPENDENT, .trip = 10 * MS, .receivers = 1, .silent = true};

    for (enum lie kind = 0; kind < LIES; kind++) {
        unsigned left_out = 0, row = 0, longest = 0, counted = 0;
        int64_t due = start;

        begin(&run, 1);
        while (now < start + FRAMES * INTERVAL + 200 * MS) {
            int64_t next = step(&run);
            for (; counted < frame_count; counted++) {
                row = frames[counted].packets ? 0 : row + 1;
                longest = row > longest ? row : longest;
                left_out += row > 0;
            }
            if (now >= due) {
                lie(kind);
                send_due(&run);
                due = now + 5 * MS;
                next = next_event(&run);
            }
            now = next < due ? next : due;
        }
        double repair = (double)repair_bytes_sent * 8 / (double)(FRAMES * INTERVAL / MS);
        printf("lie %d: repair %.0f, video %.0f kbit/s, %u of %u frames left out, %u in sequence\n", kind, repair,
               video_kbit(), left_out, FRAMES, longest);
        if (kind == HALF) { /* what is repaired for it costs frames, but never more than two of three */
            CHECK(repair <= 0.5 * WIRE / 1000 && longest <= 2 && video_kbit() >= 0.08 * WIRE / 1000);
            check_books(&run);
            continue;
        }
        CHECK(repair <= (kind == DELAY ? 0.55 : 0.5) * WIRE / 1000 && longest <= 2 && left_out <= FRAMES / 3);
        CHECK(video_kbit() >= (kind == DELAY ? 0.2 : 0.3) * WIRE / 1000 && usable(&run, CALM, FRAMES) >= 65);
        check_books(&run);
    }
}

/* In turns of ten seconds: loss 0 or 30 %, or a link of 400 or 150 kbit/s. From a second after each step on, frames are
 * usable again, no packet waits long before the link, and the rate fits. Until then hardly more waits than two frames
 * of the former size. */
static void check_steps(bool link) {
    struct run run = {.loss = INDEPENDENT, .trip = 4 * MS, .receivers = 1, .wire = 400000, .any_size = true};
    const int64_t turn = 10000 * MS, settled = 1000 * MS;
    int64_t queue = 0, peaks[FRAMES * INTERVAL / (10000 * MS) + 1] = {0}, peak_sum = 0;
    double least = 100;

    begin(&run, 1);
    while (now < start + FRAMES * INTERVAL + 200 * MS) {
        bool bad = (now - start) / turn % 2;

        if (link)
            receivers[0].from.rate = bad ? 150000 : 400000;
        else
            run.part = bad ? 0.3 : 0;
        int64_t next = step(&run), *peak_now = &peaks[(now - start) / turn];
        if ((now - start) % turn >= settled && receivers[0].from.queue > queue)
            queue = receivers[0].from.queue;
        if (bad && receivers[0].from.queue > *peak_now)
            *peak_now = receivers[0].from.queue;
        now = next;
    }
    for (unsigned from = 0; from < FRAMES; from += turn / INTERVAL)
        least = fmin(least, usable(&run, from + settled / INTERVAL, from + turn / INTERVAL));
    for (unsigned i = 1; i < FRAMES * INTERVAL / turn; i += 2)
        peak_sum += peaks[i];
    int64_t first = peak_sum / (int64_t)(FRAMES * INTERVAL / turn / 2);
    printf("steps of the %s: usable %.1f %% or more, queue %.0f ms, at first %.0f, wire %.0f and %.0f kbit/s, at most "
           "%.0f\n",
           link ? "link" : "loss", least, (double)queue / (double)MS, (double)first / (double)MS, kbit(550, 200),
           kbit(300, 200), peak());
    CHECK(least >= 97 && queue <= 100 * MS && peak() <= 1.3 * 400);
    CHECK(kbit(550, 200) >= 280 && (!link || (kbit(300, 200) <= 150 && kbit(300, 200) >= 100)));
    CHECK(first <= 140 * MS);
}

/* A link that carries just -wire and loses nothing: each packet comes after the one before it by the time that the link
 * needs for it, and is not repaired meanwhile. */
static void check_narrow(void) {
    const struct run run = {.loss = INDEPENDENT, .trip = 4 * MS, .receivers = 1, .wire = 400000, .any_size = true};

    begin(&run, 1);
    receivers[0].from.rate = 400000;
    while (now < start + FRAMES * INTERVAL + 200 * MS)
        now = step(&run);
    uint64_t repairs = tx.count[STREAM_TX_REPAIRS], media = tx.count[STREAM_TX_SENT];
    printf("a narrow link: %llu repair packets for %llu, usable %.1f %%, video %.0f kbit/s\n",
           (unsigned long long)repairs, (unsigned long long)media, usable(&run, CALM, FRAMES), video_kbit());
    CHECK(repairs <= media / 100 && usable(&run, CALM, FRAMES) >= 99 && video_kbit() >= 270);
}

/* The same with losses: each packet takes 25 ms there, and repair that is not needed makes all packets after it late.
 * The mean of four seeds. */
static void check_narrow_lossy(void) {
    struct run run = {.loss = INDEPENDENT, .part = 0.3, .trip = 4 * MS, .receivers = 1};
    const unsigned seeds = SEEDS(4);
    double in_time = 0, good = 0, video = 0;

    for (uint64_t seed = 1; seed <= seeds; seed++) {
        begin(&run, seed);
        receivers[0].from.rate = WIRE;
        while (now < start + FRAMES * INTERVAL + 200 * MS)
            now = step(&run);
        check_books(&run);
        good += usable(&run, CALM, FRAMES) / seeds;
        run.any_size = true;
        in_time += usable(&run, CALM, FRAMES) / seeds;
        run.any_size = false;
        video += video_kbit() / seeds;
    }
    printf("a narrow link with losses: in time %.1f %%, usable %.1f %%, video %.0f kbit/s\n", in_time, good, video);
    CHECK(SANITIZED || (in_time >= 72 && good >= 56 && video >= 85));
}

/* After outages of this length, from the robot or in both directions, each 8 s: ms until a new whole picture is there,
 * the mean of eight or nine. */
static double after_outages(int64_t length, bool both) {
    const struct run run = {.loss = INDEPENDENT, .trip = 4 * MS, .receivers = 1};
    const int64_t period = 8000 * MS;
    struct receiver *receiver = &receivers[0];
    int64_t sum = 0, over = 0;
    unsigned count = 0, next = 0;

    begin(&run, 1);
    while (now < start + FRAMES * INTERVAL) {
        int64_t turn = (now - start) / period, from = start + turn * period + 4000 * MS + turn * 7 % 40 * MS;
        bool out = turn && now >= from && now < from + length;

        if (frame_count < FRAMES && now >= start + frame_count * INTERVAL) {
            receiver->down.part = out;
            write_frame(&run);
        }
        receiver->down.part = out;
        receiver->up.part = out && both;
        send_due(&run);
        receive_due(&run, receiver);
        send_due(&run);
        if (out)
            over = from + length;
        if (!out && over && receiver->next > next && frames[receiver->next - 1].renewed >= receiver->broken) {
            sum += now - over;
            over = 0;
            count++;
        }
        next = receiver->next;
        int64_t event = next_event(&run);
        now = event < now + MS ? event : now + MS;
    }
    CHECK(count >= 8);
    return (double)sum / count / (double)MS;
}

static void check_outages(void) {
    static const struct {
        int64_t length;
        double down, both; /* ms at most */
    } outages[] = {
        {100 * MS, 30, 30}, {300 * MS, 50, 50}, {500 * MS, 180, 120}, {800 * MS, 150, 180}, {1500 * MS, 300, 400}};

    for (size_t i = 0; i < sizeof outages / sizeof *outages; i++) {
        double down = after_outages(outages[i].length, false), both = after_outages(outages[i].length, true);
        printf("outages of %lld ms: a picture after %.0f ms, in both directions %.0f ms\n",
               (long long)(outages[i].length / MS), down, both);
        CHECK(down <= outages[i].down && both <= outages[i].both);
    }
}

/* Without a key, a repair packet that reaches far ahead of the video can be forged: repair still works. */
static void check_forged_repair(void) {
    struct run run = {.loss = INDEPENDENT, .part = 0.3, .trip = 4 * MS, .receivers = 1, .forged = 50, .any_size = true};

    simulate(&run, 1);
    printf("forged repair packets: usable %.2f %%, video %.0f kbit/s\n", usable(&run, CALM, FRAMES), video_kbit());
    CHECK(usable(&run, CALM, FRAMES) >= 92 && video_kbit() >= 110);
}

static const struct {
    double figure, video; /* minimum: percent, kbit/s */
    struct run run;
} expected[] = {
    {99.5, 120, {.name = "with reports, independent 30 %", .loss = INDEPENDENT, .part = 0.3, .video = VIDEO}},
    {96.5, 120, {.name = "with reports, bursts of 5 on average", .loss = BURSTS, .part = 0.3, .video = VIDEO}},
    {100, 120, {.name = "with reports, every third", .loss = EVERY_THIRD, .part = 0.3, .video = VIDEO}},
    {99.9, 165, {.name = "with reports, independent 10 %", .loss = INDEPENDENT, .part = 0.1}},
    {97.5, 120, {.name = "with reports, bursts of exactly 5", .loss = FIVES, .part = 0.3, .video = VIDEO}},
    {88, 116, {.name = "with reports, outages", .loss = OUTAGES, .part = 0.3, .video = VIDEO}},
    {92,
     115,
     {.name = "with reports, outages in both directions at once",
      .loss = OUTAGES_TOGETHER,
      .part = 0.3,
      .video = VIDEO}},
    {80,
     88,
     {.name = "with reports, outages, a receiver that does not know probes",
      .loss = OUTAGES,
      .part = 0.3,
      .video = VIDEO,
      .old = true}},
    {99,
     85,
     {.name = "with reports, four at independent 30 %",
      .loss = INDEPENDENT,
      .part = 0.3,
      .video = VIDEO,
      .receivers = 4}},
    {88, 80, {.name = "with reports, four in bursts", .loss = BURSTS, .part = 0.3, .video = VIDEO, .receivers = 4}},
    {83, 75, {.name = "with reports, four in outages", .loss = OUTAGES, .part = 0.3, .video = VIDEO, .receivers = 4}},
    {100, 44, {.name = "one-way, every third", .loss = EVERY_THIRD, .part = 0.3, .silent = true}},
    {99.9,
     50,
     {.name = "one-way, every third, two repair packets a frame",
      .loss = EVERY_THIRD,
      .part = 0.3,
      .silent = true,
      .ratio = 2}}, /* otherwise the lost one of three is always the media packet */
    {99.9, 44, {.name = "one-way, independent 10 %", .loss = INDEPENDENT, .part = 0.1, .silent = true}},
    {99.7, 44, {.name = "one-way, independent 30 %", .loss = INDEPENDENT, .part = 0.3, .silent = true}},
    {99.7,
     46.5,
     {.name = "one-way, independent 30 %, small frames",
      .loss = INDEPENDENT,
      .part = 0.3,
      .silent = true,
      .smaller = 0.3}},
    {92, 44, {.name = "one-way, bursts of exactly 5", .loss = FIVES, .part = 0.3, .silent = true}},
    {88, 44, {.name = "one-way, bursts of 5 on average", .loss = BURSTS, .part = 0.3, .silent = true}},
    {82, 44, {.name = "one-way, outages", .loss = OUTAGES, .part = 0.3, .silent = true}},
};

static void check_losses(void) {
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++)
        expect(expected[i].run, expected[i].figure, expected[i].video);
}

static void check_steps_of_loss(void) {
    check_steps(false);
}

static void check_steps_of_link(void) {
    check_steps(true);
}

/* The checks, or the one with that name: each defect of tests/defects is found by one of them. */
int main(int argc, char **argv) {
    static const struct {
        const char *name;
        void (*check)(void);
    } checks[] = {{"losses", check_losses},
                  {"sudden", check_sudden},
                  {"hush", check_hush},
                  {"hush-in-bursts", check_hush_in_bursts},
                  {"forged", check_forged},
                  {"freeze", check_freeze},
                  {"narrow", check_narrow},
                  {"narrow-lossy", check_narrow_lossy},
                  {"small-wire", check_small_wire},
                  {"hostile", check_hostile},
                  {"forged-repair", check_forged_repair},
                  {"outages", check_outages},
                  {"steps-of-loss", check_steps_of_loss},
                  {"steps-of-link", check_steps_of_link}};
    unsigned done = 0;

    for (size_t i = 0; i < sizeof checks / sizeof *checks; i++)
        if (argc < 2 || !strcmp(argv[1], checks[i].name)) {
            checks[i].check();
            done++;
        }
    CHECK(done); /* otherwise there is no check with that name */
    return 0;
}
