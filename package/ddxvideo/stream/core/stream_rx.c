/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "stream_rx.h"

#include <errno.h>
#include <string.h>

/*
 * ---- The order of packets ----
 *
 * Numbers only; restore.h has the packets. Packets that come in order do not wait; after a gap they wait until the
 * missing packet comes, or until the caller gives it up. There are places for REORDER_PACKETS numbers, from the one
 * that is due on.
 */

static struct reorder_slot *slot_of(struct reorder *reorder, uint16_t sequence) {
    return &reorder->slot[sequence % REORDER_PACKETS];
}

static bool is_remembered(const struct reorder *reorder, uint16_t sequence) {
    return reorder->seen[sequence % REORDER_MEMORY / 8] >> sequence % 8 & 1;
}

/* Advances to the next number; the current one came, or is given up. */
static void step_to_next(struct reorder *reorder, bool came) {
    uint8_t *byte = &reorder->seen[reorder->next % REORDER_MEMORY / 8], bit = (uint8_t)(1 << reorder->next % 8);

    *byte = came ? *byte | bit : *byte & (uint8_t)~bit;
    reorder->lost_before += !came;
    reorder->next++;
}

static void reorder_init(struct reorder *reorder) {
    memset(reorder, 0, offsetof(struct reorder, slot));
    for (unsigned i = 0; i < REORDER_PACKETS; i++)
        reorder->slot[i].used = false;
}

/* The sequence numbers jumped: begin again, without counting a loss. */
static void begin_numbers_at(struct reorder *reorder, uint16_t sequence) {
    memset(reorder->seen, 0, sizeof reorder->seen);
    reorder->next = sequence;
    reorder->begun = true;
}

static enum reorder_result reorder_put(struct reorder *reorder, uint16_t sequence, int64_t now) {
    if (!reorder->begun)
        begin_numbers_at(reorder, sequence);
    int distance = (int16_t)(sequence - reorder->next);
    bool far = distance < -REORDER_MEMORY || distance > REORDER_JUMP;
    if (far && !rtp_is_confirmed(&reorder->stranger, sequence))
        return REORDER_LATE;
    if ((far || distance >= REORDER_PACKETS) && reorder->waiting) {
        if (far)
            reorder->stranger.next = sequence; /* the next attempt must be accepted */
        return REORDER_FULL;
    }
    reorder->stranger.there = false;
    if (distance < -REORDER_MEMORY)
        begin_numbers_at(reorder, sequence);
    else if (distance < 0)
        return is_remembered(reorder, sequence) ? REORDER_DUPLICATE : REORDER_LATE;
    else if (distance >= REORDER_PACKETS) /* too far ahead to wait for the missing packets */
        while (reorder->next != sequence)
            step_to_next(reorder, false);

    struct reorder_slot *slot = slot_of(reorder, sequence);
    if (slot->used)
        return REORDER_DUPLICATE;
    bool overtaken = false;
    for (int i = 1; reorder->waiting && i < REORDER_PACKETS && !overtaken; i++) {
        uint16_t later = (uint16_t)(sequence + i);

        overtaken = (uint16_t)(later - reorder->next) < REORDER_PACKETS && slot_of(reorder, later)->used;
    }
    *slot = (struct reorder_slot){true, now};
    reorder->waiting++;
    return overtaken ? REORDER_OUT_OF_TURN : REORDER_TAKEN;
}

/* Arrival of the first waiting packet; INT64_MAX if none waits. */
static int64_t reorder_waits_since(const struct reorder *reorder) {
    int64_t first = INT64_MAX;

    for (unsigned i = 0; reorder->waiting && i < REORDER_PACKETS; i++)
        if (reorder->slot[i].used && reorder->slot[i].arrival < first)
            first = reorder->slot[i].arrival;
    return first;
}

/* The packet that is due, or NULL; valid until reorder_take(). *lost: packets before it that were given up. */
static const struct reorder_slot *reorder_peek(const struct reorder *reorder, unsigned *lost) {
    const struct reorder_slot *slot = &reorder->slot[reorder->next % REORDER_PACKETS];

    *lost = reorder->lost_before;
    return slot->used ? slot : NULL;
}

/* Give up the packet that is due, and missing. False if it has come, or if no other packet waits. */
static bool reorder_give_up(struct reorder *reorder) {
    if (!reorder->waiting || slot_of(reorder, reorder->next)->used)
        return false;
    step_to_next(reorder, false);
    return true;
}

static void reorder_take(struct reorder *reorder) {
    slot_of(reorder, reorder->next)->used = false;
    reorder->waiting--;
    step_to_next(reorder, true);
    reorder->lost_before = 0;
}

/* The packet that is due was there, but is not any more. */
static void reorder_lose(struct reorder *reorder) {
    slot_of(reorder, reorder->next)->used = false;
    reorder->waiting--;
    step_to_next(reorder, false);
}

/* ---- The receiver ---- */

void stream_rx_init(struct stream_rx *rx, const struct stream_rx_settings *settings) {
    memset(rx, 0, offsetof(struct stream_rx, restore));
    restore_init(&rx->restore, 0);
    reorder_init(&rx->reorder);
    rx->settings = *settings;
}

void stream_rx_free(struct stream_rx *rx) {
    assembly_free(&rx->assembly);
    restore_clear(&rx->restore);
    datagram_clear(rx->queue, STREAM_RX_QUEUE);
    datagram_clear(&rx->held, 1);
    datagram_clear(&rx->held_repair, 1);
}

/* ---- Repair packets ---- */

static void count_repair(struct stream_rx *rx) {
    static const enum stream_rx_count counts[RESTORE_COUNTS] = {
        [RESTORE_RECEIVED] = STREAM_RX_REPAIR_RECEIVED, [RESTORE_REFUSED] = STREAM_RX_REPAIR_REFUSED,
        [RESTORE_USELESS] = STREAM_RX_REPAIR_USELESS,   [RESTORE_EXPIRED] = STREAM_RX_REPAIR_EXPIRED,
        [RESTORE_CORRUPT] = STREAM_RX_REPAIR_CORRUPT,   [RESTORE_RESTORED] = STREAM_RX_RESTORED};

    for (unsigned i = 0; i < RESTORE_COUNTS; i++)
        rx->count[counts[i]] = rx->repaired[i] + rx->restore.count[i];
    rx->count[STREAM_RX_REPAIR_WRONG] = rx->wrong + rx->restore.wrong;
}

/* Another source, or a jump in the sequence numbers: waiting equations are about other packets. */
static void begin_repair(struct stream_rx *rx) {
    rx->restore.count[RESTORE_EXPIRED] += rx->restore.rows;
    for (unsigned i = 0; i < RESTORE_COUNTS; i++)
        rx->repaired[i] += rx->restore.count[i];
    rx->wrong += rx->restore.wrong;
    restore_init(&rx->restore, rx->ssrc);
    count_repair(rx);
}

/* A repair packet about packets so new that some that wait would leave the window: those go out first. */
static bool must_wait(const struct stream_rx *rx, const uint8_t *data, size_t size) {
    return rx->reorder.waiting && restore_passes(&rx->restore, data, size, rx->reorder.next);
}

bool stream_rx_put_repair(struct stream_rx *rx, const uint8_t *data, size_t size, int64_t now) {
    struct repair_packet packet;
    int error = 0;

    if (must_wait(rx, data, size))
        datagram_keep(&rx->held_repair, data, size, now);
    else
        error = restore_repair(&rx->restore, data, size);
    count_repair(rx);
    if (error == -EBADMSG || !rx->followed)
        return false;
    if (rx->answers && repair_parse(data, size, &packet) && packet.media_ssrc == rx->reporter.media_ssrc)
        reporter_repair(&rx->reporter, now, packet.sequence);
    return true;
}

/* A media packet got its place, or was late. Skipped numbers are not waited for. */
static void tell_restore(struct stream_rx *rx, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                         bool taken, uint16_t due) {
    int passed = (int16_t)(rx->reorder.next - due);

    if (passed < 0 || passed > REORDER_JUMP)
        begin_repair(rx);
    if (taken || (uint16_t)(rx->restore.newest - packet->sequence) < REPAIR_PACKETS)
        restore_source(&rx->restore, data, size);
    if (passed)
        restore_give_up(&rx->restore, rx->reorder.next);
    count_repair(rx);
}

/* ---- Choice of the source ---- */

static void follow_source(struct stream_rx *rx, const struct rtp_packet *packet, int64_t now) {
    rx->followed = true;
    rx->confirmed = false;
    rx->ssrc = packet->ssrc;
    rx->window = 0;
    rx->type = packet->type;
    rx->heard = now;
    rx->queued = 0;
    rx->in_sequence = false;
    assembly_begin(&rx->assembly);
    rx->count[STREAM_RX_SOURCES]++;
    reorder_init(&rx->reorder);
    begin_repair(rx);
}

/* Keeps a packet of another source, and follows that source if the conditions hold. */
static void hear_other(struct stream_rx *rx, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                       int64_t now) {
    bool known = rx->queued && rx->other == packet->ssrc;

    rx->count[STREAM_RX_FOREIGN]++;
    if (!known) {
        if (rx->queued && rx->in_sequence && now - rx->other_heard < STREAM_RX_SILENCE_NS)
            return; /* a stray packet does not replace a source that still sends */
        rx->queued = 0;
        rx->in_sequence = false;
        rx->other = packet->ssrc;
    }
    rx->in_sequence |= known && packet->sequence == (uint16_t)(rx->other_sequence + 1);
    rx->other_sequence = packet->sequence;
    rx->other_heard = now;
    if (rx->queued < STREAM_RX_QUEUE)
        datagram_keep(&rx->queue[rx->queued++], data, size, now);
    rx->switching = rx->in_sequence && (!rx->confirmed || now - rx->heard >= STREAM_RX_SILENCE_NS);
}

static bool put_packet(struct stream_rx *rx, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                       int64_t now, bool restored) {
    uint16_t due = rx->reorder.next;
    enum reorder_result result = reorder_put(&rx->reorder, packet->sequence, now);
    bool taken = result == REORDER_TAKEN || result == REORDER_OUT_OF_TURN;

    switch (result) {
    case REORDER_TAKEN: break;
    case REORDER_OUT_OF_TURN: rx->count[STREAM_RX_REORDERED] += !restored; break;
    case REORDER_DUPLICATE: rx->count[STREAM_RX_DUPLICATE]++; break;
    case REORDER_LATE: rx->count[STREAM_RX_LATE]++; break;
    case REORDER_FULL: datagram_keep(&rx->held, data, size, now); return true;
    }
    if (result == REORDER_TAKEN && packet->has_count) {
        rx->newest = packet->frame.count;
        rx->window = packet->frame.window;
    }
    if (!restored)
        tell_restore(rx, packet, data, size, taken, due);
    return taken;
}

/* Notes a packet that came and has its place. */
static bool note_for_report(struct stream_rx *rx, const struct rtp_packet *packet, int64_t now) {
    if (!rx->settings.reports)
        return true;
    if (!rx->answers || rx->reporter.media_ssrc != packet->ssrc)
        reporter_init(&rx->reporter, rx->settings.ssrc, packet->ssrc, rx->report_header, now);
    rx->answers = packet->has_count;
    reporter_media(&rx->reporter, now, packet->sequence, packet->time, packet->marker);
    return true;
}

bool stream_rx_put(struct stream_rx *rx, const uint8_t *data, size_t size, int64_t now) {
    struct rtp_packet packet;

    rx->count[STREAM_RX_RECEIVED]++;
    rx->count[STREAM_RX_BYTES] += size;
    if (size > RTP_DATAGRAM_MAX || !rtp_parse(data, size, &packet)) {
        rx->count[STREAM_RX_GARBAGE]++;
        return false;
    }
    if (packet.type != RTP_H264 && packet.type != RTP_MPEG4) {
        rx->count[STREAM_RX_FOREIGN]++;
        return false;
    }
    if (!rx->followed) {
        follow_source(rx, &packet, now);
    } else if (packet.ssrc != rx->ssrc) {
        hear_other(rx, &packet, data, size, now);
        return false;
    } else if (packet.type != rx->type) {
        rx->count[STREAM_RX_FOREIGN]++;
        return false;
    } else {
        rx->confirmed = true;
        rx->queued = 0;
    }
    rx->heard = now;
    return put_packet(rx, &packet, data, size, now, false) && note_for_report(rx, &packet, now);
}

static void put_kept(struct stream_rx *rx, struct kept_datagram *datagram) {
    struct rtp_packet packet;

    datagram->used = false;
    rtp_parse(datagram->data, datagram->size, &packet);
    put_packet(rx, &packet, datagram->data, datagram->size, datagram->arrival, false);
}

/* Puts a restored packet into its place; its content is as credible as the repair packets. */
static void put_restored(struct stream_rx *rx, const uint8_t *data, size_t size, int64_t now) {
    struct rtp_packet packet;

    if (!rtp_parse(data, size, &packet) || packet.type != rx->type)
        rx->count[STREAM_RX_GARBAGE]++;
    else
        put_packet(rx, &packet, data, size, now, true);
}

/* Follow the other source: its packets are taken out of the queue by put_next(). */
static void switch_over(struct stream_rx *rx) {
    struct rtp_packet packet;
    unsigned queued = rx->queued;

    rtp_parse(rx->queue[0].data, rx->queue[0].size, &packet);
    follow_source(rx, &packet, rx->queue[queued - 1].arrival);
    rx->confirmed = true;
    rx->switching = false;
    rx->count[STREAM_RX_FOREIGN] -= queued; /* the queued packets are of the new source */
    rx->queued = queued;
    rx->taken = 0;
    rx->replaying = true;
}

/* Puts packets that have a place now: the datagram that had none, and restored packets. False if there is none. */
static bool put_waiting(struct stream_rx *rx, int64_t now) {
    const uint8_t *data;
    size_t size;
    uint16_t sequence;

    if (rx->held.used) {
        put_kept(rx, &rx->held);
        return !rx->held.used;
    }
    if (restore_take(&rx->restore, &data, &size, &sequence)) {
        put_restored(rx, data, size, now);
        return true;
    }
    if (!rx->held_repair.used || must_wait(rx, rx->held_repair.data, rx->held_repair.size))
        return false;
    rx->held_repair.used = false;
    restore_repair(&rx->restore, rx->held_repair.data, rx->held_repair.size);
    count_repair(rx);
    return true;
}

/* Puts the waiting datagram, once all earlier packets are out. False if none waits. */
static bool put_next(struct stream_rx *rx) {
    if (rx->switching)
        switch_over(rx);
    else if (rx->replaying && rx->taken < rx->queued)
        put_kept(rx, &rx->queue[rx->taken++]);
    else if (rx->replaying) {
        rx->replaying = false;
        rx->queued = 0;
    } else
        return false;
    return true;
}

/* ---- Gaps ---- */

static bool is_repairing(const struct stream_rx *rx) {
    return rx->settings.repairs && rx->window;
}

/* Whether the sender's window has passed the packet that is due. */
static bool is_out_of_window(const struct stream_rx *rx) {
    return (int16_t)(rx->newest - assembly_due(&rx->assembly)) > rx->window ||
           rtp_after(rx->restore.floor, rx->reorder.next);
}

/* Gives up the packet that is due if it can no longer arrive in time. */
static bool give_up_due(struct stream_rx *rx, int64_t now) {
    bool hopeless = rx->held.used || rx->held_repair.used || rx->switching || now >= stream_rx_deadline(rx) ||
                    (is_repairing(rx) && is_out_of_window(rx));

    if (!hopeless || !reorder_give_up(&rx->reorder))
        return false;
    restore_give_up(&rx->restore, rx->reorder.next);
    count_repair(rx);
    return true;
}

int64_t stream_rx_deadline(const struct stream_rx *rx) {
    int64_t since = reorder_waits_since(&rx->reorder);
    int64_t patience = is_repairing(rx) ? STREAM_RX_REPAIR_NS : rx->settings.patience;

    return since > INT64_MAX - patience ? INT64_MAX : since + patience;
}

/* ---- Frames ---- */

/* Takes the packet that is due. Whether it completes a frame: its own, or the previous one, if it begins the next. */
static bool take_packet(struct stream_rx *rx, int64_t arrival, unsigned lost, struct assembly_frame *frame) {
    struct rtp_packet packet;
    const uint8_t *data;
    size_t size;

    if (!restore_packet(&rx->restore, rx->reorder.next, &data, &size) || !rtp_parse(data, size, &packet)) {
        rx->count[STREAM_RX_GARBAGE]++; /* it was restored from repair packets that turned out to be forged */
        reorder_lose(&rx->reorder);
        return false;
    }
    if (assembly_is_next(&rx->assembly, &packet))
        return assembly_close(&rx->assembly, true, frame);
    bool good = assembly_add(&rx->assembly, &packet, lost, arrival);
    rx->count[good ? STREAM_RX_USED : STREAM_RX_GARBAGE]++;
    rx->count[STREAM_RX_LOST] += lost;
    reorder_take(&rx->reorder);
    return packet.marker && assembly_close(&rx->assembly, false, frame);
}

bool stream_rx_take(struct stream_rx *rx, int64_t now, struct assembly_frame *frame) {
    for (;;) {
        unsigned lost;
        const struct reorder_slot *slot = reorder_peek(&rx->reorder, &lost);

        if (slot) {
            if (take_packet(rx, slot->arrival, lost, frame))
                return true;
        } else if (!put_waiting(rx, now) && !give_up_due(rx, now)) {
            if (rx->switching && assembly_close(&rx->assembly, true, frame))
                return true; /* the end of the former source's last frame */
            if (!put_next(rx))
                return false;
        }
    }
}

bool stream_rx_take_last(struct stream_rx *rx, struct assembly_frame *frame) {
    return stream_rx_take(rx, INT64_MAX, frame) || assembly_close(&rx->assembly, true, frame);
}

/* ---- Reports ---- */

/* Whether the reporter is about the source that is followed. */
static bool is_reporting(const struct stream_rx *rx) {
    return rx->answers && rx->restore.ssrc == rx->reporter.media_ssrc;
}

size_t stream_rx_report(struct stream_rx *rx, int64_t now, bool refresh, uint8_t *to) {
    if (!is_reporting(rx))
        return 0;
    rx->reporter.refresh = refresh;
    return reporter_next(&rx->reporter, now, &rx->restore, to);
}

int64_t stream_rx_report_deadline(const struct stream_rx *rx) {
    return is_reporting(rx) ? reporter_deadline(&rx->reporter, &rx->restore) : INT64_MAX;
}
