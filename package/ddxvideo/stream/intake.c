/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "intake.h"

#include <string.h>

void intake_init(struct intake *intake, int64_t patience) {
    memset(intake, 0, offsetof(struct intake, reorder));
    reorder_init(&intake->reorder, patience);
    intake->patience = patience;
}

void intake_free(struct intake *intake) {
    chunk_free(&intake->chunk);
    slot_clear(intake->reorder.slot, REORDER_PACKETS);
    slot_clear(intake->queue, INTAKE_QUEUE);
    slot_clear(&intake->held, 1);
}

/* ---- Which source ---- */

static void follow(struct intake *intake, const struct rtp_packet *packet, int64_t now) {
    intake->followed = true;
    intake->confirmed = false;
    intake->ssrc = packet->ssrc;
    intake->type = packet->type;
    intake->heard = now;
    intake->fresh = true;
    intake->open = false;
    intake->known.there = false;
    intake->queued = 0;
    intake->in_sequence = false;
    intake->h264 = (struct h264_unpacker){0};
    intake->mpeg4 = (struct mpeg4_unpacker){0};
    intake->count[INTAKE_SOURCES]++;
    reorder_init(&intake->reorder, intake->patience);
}

/* A packet of another source than the one that is followed: from now on that one is, if it has the right to. */
static void hear_other(struct intake *intake, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                       int64_t now) {
    bool known = intake->queued && intake->other == packet->ssrc;

    intake->count[INTAKE_FOREIGN]++;
    if (!known) {
        if (intake->queued && intake->in_sequence && now - intake->other_heard < INTAKE_SILENCE)
            return; /* one that shows itself at work is not given up for a stray packet */
        intake->queued = 0;
        intake->in_sequence = false;
        intake->other = packet->ssrc;
    }
    intake->in_sequence |= known && packet->sequence == (uint16_t)(intake->other_sequence + 1);
    intake->other_sequence = packet->sequence;
    intake->other_heard = now;
    if (intake->queued < INTAKE_QUEUE)
        slot_fill(&intake->queue[intake->queued++], data, size, now);
    intake->switching = intake->in_sequence && (!intake->confirmed || now - intake->heard >= INTAKE_SILENCE);
}

static void put(struct intake *intake, uint16_t sequence, const uint8_t *data, size_t size, int64_t now) {
    switch (reorder_put(&intake->reorder, sequence, data, size, now)) {
    case REORDER_TAKEN: break;
    case REORDER_OUT_OF_TURN: intake->count[INTAKE_REORDERED]++; break;
    case REORDER_DUPLICATE: intake->count[INTAKE_DUPLICATE]++; break;
    case REORDER_LATE: intake->count[INTAKE_LATE]++; break;
    case REORDER_FULL: slot_fill(&intake->held, data, size, now); break;
    }
}

void intake_put(struct intake *intake, const uint8_t *data, size_t size, int64_t now) {
    struct rtp_packet packet;

    intake->count[INTAKE_RECEIVED]++;
    intake->count[INTAKE_BYTES] += size;
    if (size > RTP_DATAGRAM_MAX || !rtp_parse(data, size, &packet)) {
        intake->count[INTAKE_GARBAGE]++;
        return;
    }
    if (packet.type != RTP_H264 && packet.type != RTP_MPEG4) {
        intake->count[INTAKE_FOREIGN]++;
        return;
    }
    if (!intake->followed) {
        follow(intake, &packet, now);
    } else if (packet.ssrc != intake->ssrc) {
        hear_other(intake, &packet, data, size, now);
        return;
    } else if (packet.type != intake->type) {
        intake->count[INTAKE_FOREIGN]++;
        return;
    } else {
        intake->confirmed = true;
        intake->queued = 0;
    }
    intake->heard = now;
    put(intake, packet.sequence, data, size, now);
}

static void put_slot(struct intake *intake, struct reorder_slot *slot) {
    struct rtp_packet packet;

    slot->used = false;
    rtp_parse(slot->data, slot->size, &packet);
    put(intake, packet.sequence, slot->data, slot->size, slot->arrival);
}

/* Follow the other source: its packets are taken out of the queue by put_next(). */
static void switch_over(struct intake *intake) {
    struct rtp_packet packet;
    unsigned queued = intake->queued;

    rtp_parse(intake->queue[0].data, intake->queue[0].size, &packet);
    follow(intake, &packet, intake->queue[queued - 1].arrival);
    intake->confirmed = true;
    intake->switching = false;
    intake->count[INTAKE_FOREIGN] -= queued; /* they were not, after all */
    intake->queued = queued;
    intake->taken = 0;
    intake->replaying = true;
}

/* What waits for its turn, once all that came before it is out. False if nothing does. */
static bool put_next(struct intake *intake) {
    if (intake->held.used)
        put_slot(intake, &intake->held);
    else if (intake->switching)
        switch_over(intake);
    else if (intake->replaying && intake->taken < intake->queued)
        put_slot(intake, &intake->queue[intake->taken++]);
    else if (intake->replaying) {
        intake->replaying = false;
        intake->queued = 0;
    } else
        return false;
    return true;
}

/* ---- Frames ---- */

static void open_frame(struct intake *intake, const struct rtp_packet *packet) {
    intake->chunk.size = 0;
    intake->open = true;
    intake->frame = (struct intake_frame){.type = (enum rtp_type)packet->type,
                                          .first = intake->fresh,
                                          .time = packet->time,
                                          .has_count = packet->has_count,
                                          .has_source = packet->has_source,
                                          .frame = packet->frame};
    if (packet->has_count && !intake->fresh)
        intake->frame.missing = (uint16_t)(packet->frame.count - intake->expected);
    if (intake->frame.missing > INT16_MAX)
        intake->frame.missing = 0; /* the sender's count went back */
    intake->expected = (uint16_t)(packet->frame.count + 1);
}

/*
 * The first packet of the frame is missing. RTP's clock is the capture's, so the time is right to a unit of that clock.
 * The numbers are right if the sender has left out no frame of its source since the last frame whose numbers are known.
 */
static void derive(struct intake *intake, struct intake_frame *frame) {
    int64_t ticks = (int32_t)(frame->time - intake->known.time);
    int frames = (int16_t)(frame->frame.count - intake->known.frame.count);

    frame->has_source = frame->derived = true;
    frame->frame.capture = intake->known.frame.capture + ticks * 1000000000 / RTP_CLOCK;
    frame->frame.sequence = intake->known.frame.sequence + (uint32_t)frames;
    frame->frame.number = intake->known.frame.number + (uint32_t)frames;
}

static void complete_numbers(struct intake *intake, struct intake_frame *frame) {
    if (frame->has_source) {
        intake->known.there = true;
        intake->known.time = frame->time;
        intake->known.frame = frame->frame;
    } else if (frame->has_count && intake->known.there) {
        derive(intake, frame);
    }
}

static bool close_frame(struct intake *intake, struct intake_frame *frame) {
    if (!intake->open)
        return false;
    intake->open = intake->fresh = false;
    h264_unpack_end(&intake->h264, &intake->chunk);
    *frame = intake->frame;
    frame->data = intake->chunk.data;
    frame->size = intake->chunk.size;
    if (frame->data)
        chunk_pad(&intake->chunk);
    complete_numbers(intake, frame);
    return true;
}

static void add(struct intake *intake, const struct rtp_packet *packet, unsigned lost, int64_t arrival) {
    bool good = packet->type == RTP_H264
                    ? h264_unpack(&intake->h264, &intake->chunk, packet->payload, packet->size, lost > 0)
                    : mpeg4_unpack(&intake->mpeg4, &intake->chunk, packet->payload, packet->size, lost > 0);

    intake->count[good ? INTAKE_USED : INTAKE_GARBAGE]++;
    intake->frame.damaged |= lost || !good;
    intake->frame.arrival = arrival;
}

bool intake_take(struct intake *intake, int64_t now, struct intake_frame *frame) {
    for (;;) {
        unsigned lost;
        struct rtp_packet packet;
        const struct reorder_slot *slot = reorder_peek(&intake->reorder, now, intake->held.used, &lost);

        if (!slot && intake->switching && close_frame(intake, frame)) /* the end of what the former source said */
            return true;
        if (!slot && put_next(intake))
            continue;
        if (!slot)
            return false;
        rtp_parse(slot->data, slot->size, &packet);
        if (intake->open && packet.time != intake->frame.time && close_frame(intake, frame)) {
            frame->damaged = true; /* its last packet is missing */
            return true;
        }
        if (!intake->open)
            open_frame(intake, &packet);
        add(intake, &packet, lost, slot->arrival);
        intake->count[INTAKE_LOST] += lost;
        reorder_take(&intake->reorder);
        if (packet.marker && close_frame(intake, frame))
            return true;
    }
}

bool intake_take_last(struct intake *intake, struct intake_frame *frame) {
    if (intake_take(intake, INT64_MAX, frame))
        return true;
    if (!close_frame(intake, frame))
        return false;
    frame->damaged = true; /* its last packet is missing */
    return true;
}

int64_t intake_deadline(const struct intake *intake) {
    return reorder_deadline(&intake->reorder);
}
