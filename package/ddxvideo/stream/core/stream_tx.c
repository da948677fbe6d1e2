/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "stream_tx.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "bits.h"
#include "tuning.h"

#define FIXED 12 /* bytes of an RTP header */

void stream_tx_init(struct stream_tx *tx, const struct stream_tx_settings *settings, int64_t now) {
    memset(tx, 0, offsetof(struct stream_tx, window));
    tx->settings = *settings;
    tx->next = now;
    tx->refreshed = now - SECOND;
    tx->whole = now - tuning.whole_every;
    tx->renewed = now;
    frame_rate_init(&tx->frames, now);
    tx->patience = tuning.skip_frames_most;
    tx->link.wire = settings->wire - settings->wire / 200;
    tx->sequence = settings->media_sequence;
    budget_init(&tx->budget, tx->link.wire, tuning.bucket, tuning.fill_first, now);
    feedback_init(&tx->feedback, settings->media_ssrc, settings->wire, now);
    repair_window_init(&tx->window, settings->media_ssrc, settings->repair_ssrc, settings->repair_sequence);
}

/* ---- Input ---- */

static bool enqueue_packet(struct stream_tx *tx, int64_t now, uint16_t frame, const struct stream_tx_packet *packet) {
    if (tx->waiting == STREAM_TX_QUEUE || packet->size < FIXED || packet->size > RTP_PACKET_MAX)
        return false;
    struct repair_slot *slot = repair_waiting(&tx->window, tx->waiting++);
    slot->frame = frame;
    slot->written = now;
    slot->symbol.size = symbol_set(slot->symbol.data, packet->data, packet->size);
    return true;
}

/* Another frame waits: packets of earlier frames count less from now on, and those that wait are paced. */
static void begin_frame(struct stream_tx *tx, unsigned packets) {
    tx->count[STREAM_TX_PACKETS] += packets;
    tx->media_share *= tuning.shares_kept;
    tx->repair_share *= tuning.shares_kept;
    tx->other_share *= tuning.shares_kept;
    if (tx->waiting)
        tx->gap = tx->settings.interval / 2 / tx->waiting;
    if (tx->gap > tuning.packet_gap)
        tx->gap = tuning.packet_gap;
    tx->burst = tuning.burst_packets;
}

void stream_tx_packets(struct stream_tx *tx, int64_t now, uint16_t frame, const struct stream_tx_packet *packets,
                       unsigned count) {
    for (unsigned i = 0; i < count; i++)
        tx->count[STREAM_TX_DROPPED] += !enqueue_packet(tx, now, frame, &packets[i]);
    begin_frame(tx, count);
}

/* The payloads of a frame, of either codec. */
struct payloads {
    uint8_t type;
    struct h264_packer h264;
    struct mpeg4_packer *mpeg4;
};

static void begin_payloads(struct payloads *payloads, const uint8_t *data, size_t size) {
    if (payloads->type == RTP_H264)
        h264_pack(&payloads->h264, data, size);
    else
        mpeg4_pack(payloads->mpeg4, data, size);
}

static size_t next_payload(struct payloads *payloads, uint8_t *to, bool *last) {
    return payloads->type == RTP_H264 ? h264_pack_next(&payloads->h264, to, last)
                                      : mpeg4_pack_next(payloads->mpeg4, to, last);
}

bool stream_tx_frame(struct stream_tx *tx, int64_t now, struct rtp_packet packet, const uint8_t *data, size_t size) {
    struct payloads payloads = {.type = packet.type, .mpeg4 = &tx->mpeg4};
    uint8_t payload[RTP_ROOM], bytes[RTP_PACKET_MAX];
    unsigned before = tx->waiting, count = 0;
    uint16_t sequence = tx->sequence;
    size_t length;

    packet.ssrc = tx->settings.media_ssrc;
    packet.has_count = packet.has_source = true;
    begin_payloads(&payloads, data, size);
    for (; (length = next_payload(&payloads, payload, &packet.marker)) && count < STREAM_TX_QUEUE; count++) {
        packet.sequence = sequence++;
        size_t header = rtp_write(bytes, &packet);
        memcpy(bytes + header, payload, length);
        enqueue_packet(tx, now, packet.frame.count, &(struct stream_tx_packet){bytes, header + length});
        packet.has_source = false; /* once a frame, in its first packet */
    }
    if (!length) /* a frame that has no room now leaves a gap in the numbers */
        tx->sequence = sequence;
    if (length || tx->waiting - before < count) {
        tx->waiting = before;
        return false;
    }
    begin_frame(tx, count);
    return true;
}

void stream_tx_report(struct stream_tx *tx, int64_t now, const uint8_t *data, size_t size, uint64_t address) {
    uint64_t used = tx->feedback.count[FEEDBACK_USED];

    tx->refresh |= feedback_report(&tx->feedback, now, data, size, address);
    if (tx->feedback.count[FEEDBACK_USED] != used)
        link_rate_follow(&tx->link, &tx->budget, feedback_nearest(&tx->feedback, now), now);
}

/* Receivers of another copy of the stream have no repair, and cannot ask: for them a loss changes nothing. */
static bool is_renewal_due(const struct stream_tx *tx, int64_t now) {
    int64_t period = tx->settings.renewal;
    double loss, run;

    feedback_losses(&tx->feedback, now, &loss, &run);
    if (loss > tuning.margin_loss && !(tx->settings.others > 0))
        period = tuning.renewal_in_loss;
    return tx->settings.renewal && now - tx->renewed >= period;
}

bool stream_tx_wants_refresh(struct stream_tx *tx, int64_t now, size_t *whole) {
    bool asked = tx->refresh && now - tx->refreshed >= SECOND;

    if (!asked && !is_renewal_due(tx, now))
        return false;
    tx->renewed = now;
    *whole = 0;
    if (!asked)
        return true;
    tx->refresh = false;
    tx->refreshed = now;
    if (now - tx->whole < tuning.whole_every)
        return true;
    tx->whole = now;
    *whole = (size_t)((double)budget_tokens(&tx->budget, now) * tuning.whole_share / (1 + tx->settings.others));
    return true;
}

/* The send time of a packet. No two are equal, because a report on a packet says nothing about those after it. */
static int64_t sent_at(struct stream_tx *tx, int64_t now) {
    tx->sent = now > tx->sent ? now : tx->sent + 1;
    return tx->sent;
}

/* ---- Repair ---- */

/* Repair packets that are sent in advance for each media packet. */
static double ratio_in_advance(const struct stream_tx *tx, int64_t now) {
    int64_t silence = feedback_silence(&tx->feedback, now);
    double ratio = tuning.advance_base + tuning.advance_for_loss * tx->feedback.loss;

    if (tx->settings.repair && (silence == INT64_MAX || feedback_is_calm(&tx->feedback, now)))
        return tx->settings.ratio;
    if (!tx->settings.repair || silence < tuning.stopped)
        return 0;
    if (silence < FEEDBACK_GONE_NS)
        ratio *= tuning.stopped_repair;
    else if (tx->feedback.in_runs)
        ratio += tuning.advance_in_runs;
    return ratio > tuning.advance_most ? tuning.advance_most : ratio;
}

/* The oldest packet of the last `frames` frames in the window. */
static uint32_t frames_back(const struct stream_tx *tx, unsigned frames) {
    const struct repair_window *window = &tx->window;
    uint16_t newest = repair_sent(window, 0)->frame;
    uint32_t first = window->newest;

    for (unsigned i = 1; i < window->count; i++) {
        if ((uint16_t)(newest - repair_sent(window, i)->frame) >= frames)
            break;
        first = window->newest - i;
    }
    return first;
}

static double fill_level(struct stream_tx *tx, int64_t now) {
    return (double)budget_tokens(&tx->budget, now) / (double)budget_size(&tx->budget);
}

/* Whether to send a repair packet now; *first: the oldest packet that it covers. */
static bool needs_repair(struct stream_tx *tx, int64_t now, uint32_t *first, bool *in_advance) {
    if (!tx->settings.repair || !tx->window.count)
        return false;
    tx->feedback.spare = fill_level(tx, now) > tuning.fill_reserve;
    *in_advance = !feedback_wanted(&tx->feedback, now, first);
    if (!*in_advance)
        return true;
    *first = frames_back(tx, tx->advance % tuning.advance_whole ? tuning.advance_frames : REPAIR_FRAMES);
    return !tx->waiting && tx->owed >= 1;
}

/* Bytes that a repair packet takes on the wire. */
static size_t repair_bytes(const struct stream_tx *tx, uint32_t first) {
    const struct repair_window *window = &tx->window;
    size_t longest = 0;

    for (unsigned i = 0; i < window->count; i++) {
        size_t size = repair_sent(window, i)->symbol.size;

        longest = size > longest ? size : longest;
        if (window->newest - i == first)
            break;
    }
    return REPAIR_HEADER + longest + tx->settings.header;
}

/* Counts a packet that was just made; `written`: for the history. */
static void remember_repair(struct stream_tx *tx, int64_t now, int64_t written, size_t bytes) {
    struct history *repairs = &tx->feedback.repairs;
    uint32_t number = repairs->count ? repairs->newest + 1 : (uint16_t)(tx->window.sequence - 1);

    tx->count[STREAM_TX_REPAIRS]++;
    tx->count[STREAM_TX_BYTES] += bytes;
    history_add(repairs, number, sent_at(tx, now), written, tx->count[STREAM_TX_BYTES]);
    tx->repair_share += (double)bytes;
    tx->next = now + tuning.packet_gap;
}

static bool send_repair(struct stream_tx *tx, int64_t now, uint8_t *to, size_t *size) {
    uint32_t first;
    bool in_advance;

    if (!needs_repair(tx, now, &first, &in_advance))
        return false;
    size_t bytes = repair_bytes(tx, first);
    if (!budget_take(&tx->budget, now, bytes))
        return false;
    *size = repair_make(&tx->window, first, to);
    remember_repair(tx, now, now, bytes);
    if (in_advance) {
        tx->owed--;
        tx->advance++;
    } else {
        feedback_paid(&tx->feedback, now, bytes);
    }
    return true;
}

/* Bytes that a probe takes on the wire. */
static size_t probe_bytes(const struct stream_tx *tx) {
    return REPAIR_HEADER + tx->settings.header;
}

static bool needs_probe(struct stream_tx *tx, int64_t now) {
    return tx->settings.repair && tx->window.count && feedback_wants_probe(&tx->feedback, now, probe_bytes(tx));
}

static bool send_probe(struct stream_tx *tx, int64_t now, uint8_t *to, size_t *size) {
    size_t bytes = probe_bytes(tx);

    if (!needs_probe(tx, now) || !budget_take(&tx->budget, now, bytes))
        return false;
    *size = repair_probe(&tx->window, to);
    remember_repair(tx, now, HISTORY_PROBE, bytes);
    feedback_probed(&tx->feedback, now, bytes);
    return true;
}

/*
 * Lets repair packets follow a media packet. Some media packets get one more: if two repair packets followed each of
 * them, a loss of each third packet could hit all media packets, and a receiver refuses repair packets that reach far
 * beyond the media packets that came (restore.h).
 */
static void owe_repair(struct stream_tx *tx, double ratio) {
    tx->owed = ratio > 0 ? tx->owed + ratio + (tx->esi % tuning.step_packets == 0) : 0;
}

/* ---- Media ---- */

/* The packet that is sent next. */
static const struct repair_slot *next_media(const struct stream_tx *tx) {
    return &tx->window.slot[tx->window.next];
}

static size_t media_bytes(const struct stream_tx *tx) {
    return next_media(tx)->symbol.size - SYMBOL_PREFIX + tx->settings.header;
}

static bool send_media(struct stream_tx *tx, int64_t now, uint8_t *to, size_t *size) {
    const struct repair_slot *slot = next_media(tx);

    if (!tx->waiting || !budget_take(&tx->budget, now, media_bytes(tx)))
        return false;
    double ratio = ratio_in_advance(tx, now);
    size_t bytes = media_bytes(tx);
    const uint8_t *packet = slot->symbol.data + SYMBOL_PREFIX;
    uint16_t sequence = get16(packet + 2);
    tx->esi = tx->begun ? tx->esi + (uint16_t)(sequence - tx->esi) : sequence;
    tx->begun = true;
    *size = bytes - tx->settings.header;
    memcpy(to, packet, *size);
    repair_window_advance(&tx->window, tx->esi);
    tx->count[STREAM_TX_SENT]++;
    tx->count[STREAM_TX_MEDIA_BYTES] += bytes;
    tx->count[STREAM_TX_BYTES] += bytes;
    history_add(&tx->feedback.sent, tx->esi, sent_at(tx, now), slot->written, tx->count[STREAM_TX_BYTES]);
    tx->media_share += (double)bytes;
    owe_repair(tx, ratio);
    tx->waiting--;
    tx->burst -= tx->burst > 0;
    tx->next = tx->burst ? now : now + tx->gap;
    return true;
}

/* ---- Output ---- */

bool stream_tx_next(struct stream_tx *tx, int64_t now, uint8_t *to, size_t *size, enum stream_tx_port *port) {
    if (now < tx->next)
        return false;
    *port = STREAM_TX_REPAIR;
    if (send_repair(tx, now, to, size) || send_probe(tx, now, to, size))
        return true;
    *port = STREAM_TX_MEDIA;
    return send_media(tx, now, to, size);
}

int64_t stream_tx_deadline(struct stream_tx *tx, int64_t now) {
    int64_t time = INT64_MAX, ready;
    uint32_t first;
    bool in_advance;

    if (needs_repair(tx, now, &first, &in_advance)) {
        ready = budget_ready(&tx->budget, repair_bytes(tx, first));
        time = ready < time ? ready : time;
    }
    if (needs_probe(tx, now)) {
        ready = budget_ready(&tx->budget, probe_bytes(tx));
        time = ready < time ? ready : time;
    }
    if (tx->waiting) {
        ready = budget_ready(&tx->budget, media_bytes(tx));
        time = ready < time ? ready : time;
    }
    return time < tx->next ? tx->next : time;
}

bool stream_tx_other(struct stream_tx *tx, int64_t now, size_t size) {
    bool may_go = budget_take(&tx->budget, now, size);

    tx->count[may_go ? STREAM_TX_OTHERS : STREAM_TX_OTHERS_LOST]++;
    if (!may_go)
        return false;
    tx->count[STREAM_TX_BYTES] += size;
    tx->other_share += (double)size;
    return true;
}

/* For each byte of media, as in the last seconds. */
static double past_part(const struct stream_tx *tx, double share, double least) {
    double past = tx->media_share > 0 ? share / tx->media_share : 0;

    return past > least ? past : least;
}

/* Bytes of repair and of other packets for each byte of media. Of repair at least as many as are about to be sent in
 * advance. */
static double part_beside(const struct stream_tx *tx, int64_t now) {
    return past_part(tx, tx->repair_share, ratio_in_advance(tx, now) * tuning.repair_size_ratio) +
           past_part(tx, tx->other_share, tx->settings.others);
}

/* Whether the budget cannot pay for repair, or for a packet of the last frame, within half a frame interval: another
 * frame would be late. A packet that waits although it is due now does not count: the sending thread of a busy machine
 * comes late, and then sends at once. */
static bool is_behind(struct stream_tx *tx, int64_t now) {
    int64_t late = tx->settings.interval * tx->frames.every / 2;
    uint32_t first;
    bool in_advance;

    if (tx->waiting && now - next_media(tx)->written > late && stream_tx_deadline(tx, now) > now)
        return true;
    return needs_repair(tx, now, &first, &in_advance) && !in_advance &&
           budget_ready(&tx->budget, repair_bytes(tx, first)) > now + late;
}

/* Whether packets wait before the link, so that another frame would be late. */
static bool is_link_full(struct stream_tx *tx, int64_t now) {
    return link_rate_is_full(&tx->link, feedback_nearest(&tx->feedback, now), &tx->feedback.sent, now);
}

/*
 * Whether a frame is left out, because repair of the frames before it takes what the bucket has for that, or because
 * nothing gets through, or no report: it would be of no use to the receiver, and have to be repaired as well after the
 * outage. A report can be forged, so it never stops the video: at least each third frame is sent, and on average 70 %.
 */
static bool leaves_out(struct stream_tx *tx, int64_t now) {
    const struct deficit *deficit = feedback_single(&tx->feedback, now);
    double left = (fill_level(tx, now) - tuning.fill_reserve) * (double)budget_size(&tx->budget);

    tx->patience += tx->patience < tuning.skip_frames_most ? tuning.skip_share : 0;

    int64_t silence = feedback_silence(&tx->feedback, now);

    if (is_link_full(tx, now) || (silence >= tuning.silent && silence < FEEDBACK_GONE_NS))
        left = -1;
    else if (!tx->settings.repair || !tx->window.count || !deficit || !deficit->needed)
        left = INFINITY;
    else if (deficit->run < tuning.outage_packets)
        left -= deficit->needed * (double)repair_bytes(tx, deficit->first);
    else
        left = -1;
    bool yes = left < 0 && tx->skipped < tuning.skip_frames && tx->patience >= 1;
    tx->skipped = yes ? tx->skipped + 1 : 0;
    tx->patience -= yes;
    return yes;
}

/* How far losses come in runs, 0 to 1. */
static double part_in_runs(const struct stream_tx *tx, int64_t now) {
    double loss, run;

    feedback_losses(&tx->feedback, now, &loss, &run);
    return run < tuning.runs_packets || loss <= 0 ? 0 : run < tuning.runs_packets + 1 ? run - tuning.runs_packets : 1;
}

/* Bytes that the next frame and its repair may take more than the rate, since the bucket is fuller than it should be;
 * negative: less. */
static double spare_bytes(struct stream_tx *tx, int64_t now, bool one_way) {
    double tokens = (double)budget_tokens(&tx->budget, now), size = (double)budget_size(&tx->budget);
    double runs = part_in_runs(tx, now), many = tuning.fill + runs * (tuning.fill_in_runs_many - tuning.fill);

    if (!one_way && feedback_single(&tx->feedback, now))
        return (tokens - tuning.fill * size) / tuning.fill_frames_alone;
    return (tokens - (one_way ? tuning.fill_one_way : many) * size) /
           (tuning.fill_frames + runs * (tuning.fill_frames_in_runs - tuning.fill_frames));
}

/* Bytes of a frame with its headers if `bytes` are for it and its repair. A frame whose repair the receivers may not
 * cause (feedback.h) would be of no use, and those after it neither. */
static double repairable_bytes(struct stream_tx *tx, int64_t now, double bytes, unsigned frames) {
    double repair = past_part(tx, tx->repair_share, 0), rate = feedback_repair_rate(&tx->feedback, now);
    double most = rate * (double)tx->settings.interval / (8.0 * SECOND) * frames;

    bytes /= 1 + part_beside(tx, now);
    return repair > 0 && bytes * repair > most ? most / repair : bytes;
}

/* Whether the frame is left out because only each second or third one can be sent and repaired. A fair frame has
 * headers, too, of which each frame that is left out saves a set. */
static bool is_thinned(struct stream_tx *tx, int64_t now, double wire) {
    double header = RTP_HEADER_MAX + (double)tx->settings.header;
    double fair = fmax(tuning.rate_fair_bytes, tuning.rate_fair_share * wire) + header;
    int64_t silence = feedback_silence(&tx->feedback, now);

    if (!tx->settings.repair || silence >= FEEDBACK_GONE_NS)
        frame_rate_reset(&tx->frames, now);
    else if (silence < tuning.stopped)
        frame_rate_learn(&tx->frames, now, repairable_bytes(tx, now, wire, 1), fair,
                         feedback_least_loss(&tx->feedback, now));
    bool yes = frame_rate_leaves_out(&tx->frames);
    tx->skipped += yes;
    return yes;
}

/* Bytes that a frame has at most so that it can be repaired, if a receiver is alone and loses much; else a smaller
 * frame would not help it. `bytes`: for the frame and its repair. */
static double most_bytes(struct stream_tx *tx, int64_t now, double wire, double bytes) {
    if (!feedback_single(&tx->feedback, now) || feedback_least_loss(&tx->feedback, now) <= tuning.rate_loss)
        return INFINITY;
    return fmax(repairable_bytes(tx, now, bytes, tx->frames.every) - RTP_HEADER_MAX - (double)tx->settings.header,
                wire * tx->frames.every * tuning.frame_least_share / (1 + tx->settings.others));
}

size_t stream_tx_allowance(struct stream_tx *tx, int64_t now) {
    const struct stream_tx_settings *settings = &tx->settings;
    int64_t silence = feedback_silence(&tx->feedback, now);
    double frame = (double)settings->interval / (8.0 * SECOND); /* bytes of a frame at 1 bit/s */
    double wire = (double)tx->budget.rate * frame;
    double spare = spare_bytes(tx, now, silence >= FEEDBACK_GONE_NS);

    if (is_thinned(tx, now, wire) || is_behind(tx, now) || leaves_out(tx, now))
        return 0;
    frame_rate_sends(&tx->frames);
    double every = tx->frames.every;
    double video = settings->video ? (double)settings->video * frame : wire * STREAM_TX_VIDEO;
    if (silence >= tuning.stopped && silence < FEEDBACK_GONE_NS) {
        wire *= tuning.stopped_rate;
        spare = spare > 0 ? 0 : spare;
    }
    double bytes = (wire * every + spare) / (1 + part_beside(tx, now)) - RTP_HEADER_MAX - (double)settings->header;
    double part = feedback_single(&tx->feedback, now) ? tuning.frame_least_share_alone : tuning.frame_least_share;
    double most = most_bytes(tx, now, wire, wire * every + spare);
    if (silence < tuning.stopped)
        bytes = fmin(fmax(bytes, wire * part / (1 + settings->others)), most);
    if (link_rate_was_full(&tx->link, now) && bytes > wire * tuning.link_full_share)
        bytes = wire * tuning.link_full_share;
    if (bytes > video)
        bytes = video;
    return bytes < tuning.frame_least_bytes ? tuning.frame_least_bytes : (size_t)bytes;
}
