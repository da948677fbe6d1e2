/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "dispatch.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "bits.h"

#define MS INT64_C(1000000)
#define SECOND INT64_C(1000000000)
#define BUCKET (300 * MS)
#define FULL 0.85 /* fill level of the bucket, kept for bursts of reported losses */
#define FULL_IN_RUNS \
    0.5                     /* the same where losses come in runs: after each run the bucket is less full, and
                               smaller frames for a while would look worse than a bucket that is never full */
#define FULL_ONE_WAY 0.5    /* the same without reports, for frames of different sizes only */
#define BEGIN 0.5           /* how full it is at first; with 0.5 % less than the rate the mean of 30 s is never more */
#define HORIZON 4           /* frames in which the fill level is restored */
#define HORIZON_IN_RUNS 12  /* the same where losses come in runs */
#define RUNS_BEGIN 1.4      /* mean length of runs at 30 % independent loss; from one more on, all come in runs */
#define FADE (1 - 1.0 / 75) /* of the shares, each frame */
#define SPARE 0.25          /* fill level up to which a single receiver cannot empty the bucket */
#define OUTAGE 20           /* packets lost in sequence, after which most frames are left out */
#define LINK_FULL (50 * MS) /* ns that packets wait before the link, above which frames are left out */
#define LINK_FULL_NOW (65 * MS) /* the same, of the last packet that arrived, while others are on their way */
#define LINK_FULL_PART 0.25     /* of the rate that a frame has then, if it is not left out */
#define LINK_STEP (100 * MS)    /* from one change of the rate to the next */
#define LINK_BUCKET (80 * MS)   /* what the bucket holds while the link is slower than -wire */
#define LINK_DRAIN 0.85         /* of the link's rate, while there is a queue */
#define LINK_FALL 0.5           /* of the rate, at least, in one step: less than the link's rate may have arrived */
#define LINK_RISE 1.15
#define LINK_SLOWLY 1.05
#define LINK_LEAST 50e3          /* bit/s */
#define LINK_PART 0.3            /* of -wire, at least: delays can be forged */
#define WHOLE_EVERY (4 * SECOND) /* from one whole picture to the next */
#define WHOLE_PART 0.35          /* of the bytes in the bucket, for one: it waits 0.1 s before a link of this rate */
#define YIELD 2                  /* most frames that are left out in sequence for repair or in an outage, */
#define YIELD_MOST 40            /* most of them at once, */
#define YIELD_PART 0.3           /* and of all frames on average */
#define LEAST 100                /* bytes of a frame; less is not worth its headers */
#define LEAST_PART 0.30    /* of the rate that frames get, however much repair is wanted: else it leaves bad pictures */
#define LEAST_ALONE 0.45   /* the same for a single receiver */
#define FRAME_HEADERS 40   /* bytes of the RTP header of a frame's first packet */
#define GAP MS             /* between packets, at most */
#define BURST 3            /* packets of a frame that go at once: few frames are larger, and 3.6 kB fit each queue */
#define STOPPED (200 * MS) /* without reports: they have just stopped */
#define SILENT (300 * MS)  /* without reports: probably an outage in both directions */
#define REDUCED 0.5        /* of the rate, then */
#define FEWER 0.85         /* of the repair packets: they are still as long as the larger frames before */
#define ADVANCE_FRAMES 8
#define LONGER 1.1       /* a repair packet than a media packet */
#define OUT_OF_STEP 64   /* media packets, after which one more repair packet goes */
#define MORE_IN_RUNS 0.6 /* repair packets for each media packet that are added where losses come in runs */
#define ADVANCE_WHOLE 3  /* each third one covers the whole window */
#define FIXED 12         /* bytes of an RTP header */

void dispatch_init(struct dispatch *dispatch, const struct dispatch_settings *settings, int64_t now) {
    memset(dispatch, 0, offsetof(struct dispatch, window));
    dispatch->settings = *settings;
    dispatch->next = now;
    dispatch->refreshed = now - SECOND;
    dispatch->whole = now - WHOLE_EVERY;
    dispatch->patience = YIELD_MOST;
    dispatch->wire = settings->wire - settings->wire / 200;
    budget_init(&dispatch->budget, dispatch->wire, BUCKET, BEGIN, now);
    feedback_init(&dispatch->feedback, settings->media_ssrc, settings->wire, now);
    repair_window_init(&dispatch->window, settings->media_ssrc, settings->repair_ssrc, settings->repair_sequence);
}

/* ---- Input ---- */

static bool enqueue(struct dispatch *dispatch, int64_t now, uint16_t frame, const struct dispatch_packet *packet) {
    if (dispatch->waiting == DISPATCH_QUEUE || packet->size < FIXED || packet->size > RTP_PACKET_MAX)
        return false;
    struct dispatch_slot *slot = &dispatch->queue[(dispatch->head + dispatch->waiting++) % DISPATCH_QUEUE];
    slot->frame = frame;
    slot->size = (uint16_t)packet->size;
    slot->written = now;
    memcpy(slot->data, packet->data, packet->size);
    return true;
}

unsigned dispatch_room(const struct dispatch *dispatch) {
    return DISPATCH_QUEUE - dispatch->waiting;
}

void dispatch_frame(struct dispatch *dispatch, int64_t now, uint16_t frame, const struct dispatch_packet *packets,
                    unsigned count) {
    dispatch->count[DISPATCH_PACKETS] += count;
    dispatch->media_share *= FADE;
    dispatch->repair_share *= FADE;
    dispatch->other_share *= FADE;
    for (unsigned i = 0; i < count; i++)
        dispatch->count[DISPATCH_DROPPED] += !enqueue(dispatch, now, frame, &packets[i]);
    if (dispatch->waiting)
        dispatch->gap = dispatch->settings.interval / 2 / dispatch->waiting;
    if (dispatch->gap > GAP)
        dispatch->gap = GAP;
    dispatch->burst = BURST;
}

/* Sets the rate at which the bucket fills. While it is lower than -wire, the bucket holds less: its bytes would only
 * wait in the link's queue. */
static void set_rate(struct dispatch *dispatch, double rate) {
    double most = (double)dispatch->wire, least = fmax(LINK_LEAST, most * LINK_PART);
    int64_t packet = (int64_t)(2 * RTP_PACKET_MAX * 8 * (double)SECOND / rate);

    rate = rate > most ? most : rate < least ? least : rate;
    dispatch->budget.rate = (int64_t)rate;
    dispatch->budget.depth = rate >= most ? BUCKET : packet > LINK_BUCKET ? packet : LINK_BUCKET;
    if (dispatch->budget.depth > BUCKET)
        dispatch->budget.depth = BUCKET;
}

/*
 * The rate follows the link. If packets wait in a queue before the link, the link is full, and what arrives is its
 * rate: the rate is set a little lower, so that the queue drains. Without a queue the rate rises again, more slowly
 * where the link was full before.
 */
static void follow_link(struct dispatch *dispatch, int64_t now) {
    const struct deficit *nearest = feedback_nearest(&dispatch->feedback, now);
    double rate = (double)dispatch->budget.rate;

    if (!nearest || now - dispatch->followed < LINK_STEP)
        return;
    if (nearest->link > 0) {
        dispatch->link = nearest->link;
        dispatch->followed = now;
        if (rate > LINK_DRAIN * dispatch->link)
            set_rate(dispatch, fmax(LINK_DRAIN * dispatch->link, LINK_FALL * rate));
    } else if (nearest->queue < DEFICIT_QUEUE / 2 && dispatch->budget.rate < dispatch->wire) {
        bool near = rate > 0.8 * dispatch->link && rate < 1.1 * dispatch->link;

        dispatch->followed = now;
        set_rate(dispatch, rate * (near ? LINK_SLOWLY : LINK_RISE));
    }
}

void dispatch_report(struct dispatch *dispatch, int64_t now, const uint8_t *data, size_t size, uint64_t address) {
    uint64_t used = dispatch->feedback.count[FEEDBACK_USED];

    dispatch->refresh |= feedback_report(&dispatch->feedback, now, data, size, address);
    if (dispatch->feedback.count[FEEDBACK_USED] != used)
        follow_link(dispatch, now);
}

bool dispatch_wants_refresh(struct dispatch *dispatch, int64_t now, size_t *whole) {
    if (!dispatch->refresh || now - dispatch->refreshed < SECOND)
        return false;
    dispatch->refresh = false;
    dispatch->refreshed = now;
    *whole = 0;
    if (now - dispatch->whole < WHOLE_EVERY)
        return true;
    dispatch->whole = now;
    *whole = (size_t)((double)budget_tokens(&dispatch->budget, now) * WHOLE_PART / (1 + dispatch->settings.others));
    return true;
}

/* The send time of a packet. No two are equal, because a report on a packet says nothing about those after it. */
static int64_t sent_at(struct dispatch *dispatch, int64_t now) {
    dispatch->sent = now > dispatch->sent ? now : dispatch->sent + 1;
    return dispatch->sent;
}

/* ---- Repair ---- */

/* Repair packets that are sent in advance for each media packet. */
static double ratio_in_advance(const struct dispatch *dispatch, int64_t now) {
    int64_t silence = feedback_silence(&dispatch->feedback, now);
    double ratio = 0.35 + 5 * dispatch->feedback.loss;

    if (dispatch->settings.repair && (silence == INT64_MAX || feedback_is_calm(&dispatch->feedback, now)))
        return dispatch->settings.ratio;
    if (!dispatch->settings.repair || silence < STOPPED)
        return 0;
    if (silence < FEEDBACK_GONE)
        ratio *= FEWER;
    else if (dispatch->feedback.in_runs)
        ratio += MORE_IN_RUNS;
    return ratio > 2.5 ? 2.5 : ratio;
}

/* The oldest packet of the last `frames` frames in the window. */
static uint32_t frames_back(const struct dispatch *dispatch, unsigned frames) {
    const struct repair_window *window = &dispatch->window;
    uint16_t newest = window->frame[window->newest % REPAIR_PACKETS];
    uint32_t first = window->newest;

    for (unsigned i = 1; i < window->count; i++) {
        if ((uint16_t)(newest - window->frame[(window->newest - i) % REPAIR_PACKETS]) >= frames)
            break;
        first = window->newest - i;
    }
    return first;
}

static double fill_level(struct dispatch *dispatch, int64_t now) {
    return (double)budget_tokens(&dispatch->budget, now) / (double)budget_size(&dispatch->budget);
}

/* Whether to send a repair packet now; *first: the oldest packet that it covers. */
static bool needs_repair(struct dispatch *dispatch, int64_t now, uint32_t *first, bool *in_advance) {
    if (!dispatch->settings.repair || !dispatch->window.count)
        return false;
    dispatch->feedback.spare = fill_level(dispatch, now) > SPARE;
    *in_advance = !feedback_wanted(&dispatch->feedback, now, first);
    if (!*in_advance)
        return true;
    *first = frames_back(dispatch, dispatch->advance % ADVANCE_WHOLE ? ADVANCE_FRAMES : REPAIR_FRAMES);
    return !dispatch->waiting && dispatch->owed >= 1;
}

/* Bytes that a repair packet takes on the wire. */
static size_t repair_bytes(const struct dispatch *dispatch, uint32_t first) {
    const struct repair_window *window = &dispatch->window;
    size_t longest = 0;

    for (unsigned i = 0; i < window->count; i++) {
        uint32_t esi = window->newest - i;

        if (window->source[esi % REPAIR_PACKETS].size > longest)
            longest = window->source[esi % REPAIR_PACKETS].size;
        if (esi == first)
            break;
    }
    return REPAIR_HEADER + longest + dispatch->settings.header;
}

/* Counts a packet that was just made; `written`: for the history. */
static void remember_repair(struct dispatch *dispatch, int64_t now, int64_t written, size_t bytes) {
    struct history *repairs = &dispatch->feedback.repairs;
    uint32_t number = repairs->count ? repairs->newest + 1 : (uint16_t)(dispatch->window.sequence - 1);

    dispatch->count[DISPATCH_REPAIRS]++;
    dispatch->count[DISPATCH_BYTES] += bytes;
    history_add(repairs, number, sent_at(dispatch, now), written, dispatch->count[DISPATCH_BYTES]);
    dispatch->repair_share += (double)bytes;
    dispatch->next = now + GAP;
}

static bool send_repair(struct dispatch *dispatch, int64_t now, uint8_t *to, size_t *size) {
    uint32_t first;
    bool in_advance;

    if (!needs_repair(dispatch, now, &first, &in_advance))
        return false;
    size_t bytes = repair_bytes(dispatch, first);
    if (!budget_take(&dispatch->budget, now, bytes))
        return false;
    *size = repair_make(&dispatch->window, first, to);
    remember_repair(dispatch, now, now, bytes);
    if (in_advance) {
        dispatch->owed--;
        dispatch->advance++;
    } else {
        feedback_paid(&dispatch->feedback, now, bytes);
    }
    return true;
}

/* Bytes that a probe takes on the wire. */
static size_t probe_bytes(const struct dispatch *dispatch) {
    return REPAIR_HEADER + dispatch->settings.header;
}

static bool needs_probe(struct dispatch *dispatch, int64_t now) {
    return dispatch->settings.repair && dispatch->window.count &&
           feedback_wants_probe(&dispatch->feedback, now, probe_bytes(dispatch));
}

static bool send_probe(struct dispatch *dispatch, int64_t now, uint8_t *to, size_t *size) {
    size_t bytes = probe_bytes(dispatch);

    if (!needs_probe(dispatch, now) || !budget_take(&dispatch->budget, now, bytes))
        return false;
    *size = repair_probe(&dispatch->window, to);
    remember_repair(dispatch, now, HISTORY_PROBE, bytes);
    feedback_probed(&dispatch->feedback, now, bytes);
    return true;
}

/*
 * Lets repair packets follow a media packet. Some media packets get one more: if two repair packets followed each of
 * them, a loss of each third packet could hit all media packets, and a receiver refuses repair packets that reach far
 * beyond the media packets that came (restore.h).
 */
static void owe_repair(struct dispatch *dispatch, double ratio) {
    dispatch->owed = ratio > 0 ? dispatch->owed + ratio + (dispatch->esi % OUT_OF_STEP == 0) : 0;
}

/* ---- Media ---- */

static size_t media_bytes(const struct dispatch *dispatch) {
    return dispatch->queue[dispatch->head].size + dispatch->settings.header;
}

static bool send_media(struct dispatch *dispatch, int64_t now, uint8_t *to, size_t *size) {
    const struct dispatch_slot *slot = &dispatch->queue[dispatch->head];

    if (!dispatch->waiting || !budget_take(&dispatch->budget, now, media_bytes(dispatch)))
        return false;
    double ratio = ratio_in_advance(dispatch, now);
    uint16_t sequence = get16(slot->data + 2);
    dispatch->esi = dispatch->begun ? dispatch->esi + (uint16_t)(sequence - dispatch->esi) : sequence;
    dispatch->begun = true;
    memcpy(to, slot->data, slot->size);
    *size = slot->size;
    repair_window_add(&dispatch->window, dispatch->esi, slot->frame, slot->data, slot->size);
    dispatch->count[DISPATCH_SENT]++;
    dispatch->count[DISPATCH_MEDIA_BYTES] += media_bytes(dispatch);
    dispatch->count[DISPATCH_BYTES] += media_bytes(dispatch);
    history_add(&dispatch->feedback.sent, dispatch->esi, sent_at(dispatch, now), slot->written,
                dispatch->count[DISPATCH_BYTES]);
    dispatch->media_share += (double)media_bytes(dispatch);
    owe_repair(dispatch, ratio);
    dispatch->head = (dispatch->head + 1) % DISPATCH_QUEUE;
    dispatch->waiting--;
    dispatch->burst -= dispatch->burst > 0;
    dispatch->next = dispatch->burst ? now : now + dispatch->gap;
    return true;
}

/* ---- Output ---- */

bool dispatch_next(struct dispatch *dispatch, int64_t now, uint8_t *to, size_t *size, enum dispatch_port *port) {
    if (now < dispatch->next)
        return false;
    *port = DISPATCH_REPAIR;
    if (send_repair(dispatch, now, to, size) || send_probe(dispatch, now, to, size))
        return true;
    *port = DISPATCH_MEDIA;
    return send_media(dispatch, now, to, size);
}

int64_t dispatch_deadline(struct dispatch *dispatch, int64_t now) {
    int64_t time = INT64_MAX, ready;
    uint32_t first;
    bool in_advance;

    if (needs_repair(dispatch, now, &first, &in_advance)) {
        ready = budget_ready(&dispatch->budget, repair_bytes(dispatch, first));
        time = ready < time ? ready : time;
    }
    if (needs_probe(dispatch, now)) {
        ready = budget_ready(&dispatch->budget, probe_bytes(dispatch));
        time = ready < time ? ready : time;
    }
    if (dispatch->waiting) {
        ready = budget_ready(&dispatch->budget, media_bytes(dispatch));
        time = ready < time ? ready : time;
    }
    return time < dispatch->next ? dispatch->next : time;
}

bool dispatch_other(struct dispatch *dispatch, int64_t now, size_t size) {
    bool may_go = budget_take(&dispatch->budget, now, size);

    dispatch->count[may_go ? DISPATCH_OTHERS : DISPATCH_OTHERS_LOST]++;
    if (!may_go)
        return false;
    dispatch->count[DISPATCH_BYTES] += size;
    dispatch->other_share += (double)size;
    return true;
}

/* For each byte of media, as in the last seconds. */
static double past_part(const struct dispatch *dispatch, double share, double least) {
    double past = dispatch->media_share > 0 ? share / dispatch->media_share : 0;

    return past > least ? past : least;
}

/* Bytes of repair and of other packets for each byte of media. Of repair at least as many as are about to be sent in
 * advance. */
static double part_beside(const struct dispatch *dispatch, int64_t now) {
    return past_part(dispatch, dispatch->repair_share, ratio_in_advance(dispatch, now) * LONGER) +
           past_part(dispatch, dispatch->other_share, dispatch->settings.others);
}

/* Whether the budget cannot pay for repair, or for a packet of the last frame, within half a frame interval: another
 * frame would be late. A packet that waits although it is due now does not count: the sending thread of a busy machine
 * comes late, and then sends at once. */
static bool is_behind(struct dispatch *dispatch, int64_t now) {
    int64_t late = dispatch->settings.interval / 2;
    uint32_t first;
    bool in_advance;

    if (dispatch->waiting && now - dispatch->queue[dispatch->head].written > late &&
        dispatch_deadline(dispatch, now) > now)
        return true;
    return needs_repair(dispatch, now, &first, &in_advance) && !in_advance &&
           budget_ready(&dispatch->budget, repair_bytes(dispatch, first)) > now + late;
}

/* Whether packets wait before the link, so that another frame would be late. */
static bool is_link_full(const struct dispatch *dispatch, int64_t now) {
    const struct deficit *nearest = feedback_nearest(&dispatch->feedback, now);
    const struct history *sent = &dispatch->feedback.sent;

    return nearest && (nearest->queue > LINK_FULL ||
                       (nearest->delay > LINK_FULL_NOW && history_sent(sent, sent->newest) > nearest->arrival));
}

/*
 * Whether a frame is left out, because repair of the frames before it takes what the bucket has for that, or because
 * nothing gets through, or no report: it would be of no use to the receiver, and have to be repaired as well after the
 * outage. A report can be forged, so it never stops the video: at least each third frame is sent, and on average 70 %.
 */
static bool yields(struct dispatch *dispatch, int64_t now) {
    const struct deficit *deficit = feedback_single(&dispatch->feedback, now);
    double left = (fill_level(dispatch, now) - SPARE) * (double)budget_size(&dispatch->budget);

    dispatch->patience += dispatch->patience < YIELD_MOST ? YIELD_PART : 0;

    int64_t silence = feedback_silence(&dispatch->feedback, now);

    if (is_link_full(dispatch, now) || (silence >= SILENT && silence < FEEDBACK_GONE))
        left = -1;
    else if (!dispatch->settings.repair || !dispatch->window.count || !deficit || !deficit->needed)
        left = INFINITY;
    else if (deficit->run < OUTAGE)
        left -= deficit->needed * (double)repair_bytes(dispatch, deficit->first);
    else
        left = -1;
    bool yes = left < 0 && dispatch->skipped < YIELD && dispatch->patience >= 1;
    dispatch->skipped = yes ? dispatch->skipped + 1 : 0;
    dispatch->patience -= yes;
    return yes;
}

/* How far losses come in runs, 0 to 1. */
static double part_in_runs(const struct dispatch *dispatch, int64_t now) {
    double loss, run;

    feedback_losses(&dispatch->feedback, now, &loss, &run);
    return run < RUNS_BEGIN || loss <= 0 ? 0 : run < RUNS_BEGIN + 1 ? run - RUNS_BEGIN : 1;
}

/* Bytes that the next frame and its repair may take more than the rate, since the bucket is fuller than it should be;
 * negative: less. */
static double spare_bytes(struct dispatch *dispatch, int64_t now, bool one_way) {
    double runs = part_in_runs(dispatch, now), full = FULL + runs * (FULL_IN_RUNS - FULL);
    double tokens = (double)budget_tokens(&dispatch->budget, now), size = (double)budget_size(&dispatch->budget);

    return (tokens - (one_way ? FULL_ONE_WAY : full) * size) / (HORIZON + runs * (HORIZON_IN_RUNS - HORIZON));
}

size_t dispatch_allowance(struct dispatch *dispatch, int64_t now) {
    const struct dispatch_settings *settings = &dispatch->settings;
    int64_t silence = feedback_silence(&dispatch->feedback, now);
    double frame = (double)settings->interval / (8.0 * SECOND); /* bytes of a frame at 1 bit/s */
    double wire = (double)dispatch->budget.rate * frame;
    double video = settings->video ? (double)settings->video * frame : wire * DISPATCH_VIDEO;
    double spare = spare_bytes(dispatch, now, silence >= FEEDBACK_GONE);

    if (is_behind(dispatch, now) || yields(dispatch, now))
        return 0;
    if (silence >= STOPPED && silence < FEEDBACK_GONE) {
        wire *= REDUCED;
        spare = spare > 0 ? 0 : spare;
    }
    double bytes = (wire + spare) / (1 + part_beside(dispatch, now));
    bytes -= FRAME_HEADERS + (double)settings->header;
    double part = feedback_single(&dispatch->feedback, now) ? LEAST_ALONE : LEAST_PART;
    double least = wire * part / (1 + settings->others);
    if (silence < STOPPED && bytes < least)
        bytes = least;
    if (is_link_full(dispatch, now) && bytes > wire * LINK_FULL_PART)
        bytes = wire * LINK_FULL_PART;
    if (bytes > video)
        bytes = video;
    return bytes < LEAST ? LEAST : (size_t)bytes;
}
