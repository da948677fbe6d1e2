/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "intake.h"

#include <errno.h>
#include <string.h>

void intake_init(struct intake *intake, int64_t patience, bool repairs) {
    memset(intake, 0, offsetof(struct intake, restore));
    restore_init(&intake->restore, 0);
    reorder_init(&intake->reorder);
    intake->patience = patience;
    intake->repairs = repairs;
}

void intake_free(struct intake *intake) {
    assembly_free(&intake->assembly);
    slot_clear(intake->reorder.slot, REORDER_PACKETS);
    slot_clear(intake->queue, INTAKE_QUEUE);
    slot_clear(&intake->held, 1);
}

/* ---- Repair packets ---- */

static void count_repair(struct intake *intake) {
    static const enum intake_count counts[RESTORE_COUNTS] = {
        [RESTORE_RECEIVED] = INTAKE_REPAIR_RECEIVED, [RESTORE_REFUSED] = INTAKE_REPAIR_REFUSED,
        [RESTORE_USELESS] = INTAKE_REPAIR_USELESS,   [RESTORE_EXPIRED] = INTAKE_REPAIR_EXPIRED,
        [RESTORE_CORRUPT] = INTAKE_REPAIR_CORRUPT,   [RESTORE_RESTORED] = INTAKE_RESTORED};

    for (unsigned i = 0; i < RESTORE_COUNTS; i++)
        intake->count[counts[i]] = intake->repaired[i] + intake->restore.count[i];
    intake->count[INTAKE_REPAIR_WRONG] = intake->wrong + intake->restore.wrong;
}

/* Another source, or a jump in the sequence numbers: waiting equations are about other packets. */
static void begin_repair(struct intake *intake) {
    intake->restore.count[RESTORE_EXPIRED] += intake->restore.rows;
    for (unsigned i = 0; i < RESTORE_COUNTS; i++)
        intake->repaired[i] += intake->restore.count[i];
    intake->wrong += intake->restore.wrong;
    restore_init(&intake->restore, intake->ssrc);
    count_repair(intake);
}

bool intake_put_repair(struct intake *intake, const uint8_t *data, size_t size) {
    int error = restore_repair(&intake->restore, data, size);

    count_repair(intake);
    return error != -EBADMSG && intake->followed;
}

/* A media packet got its place, or was late. Skipped numbers are not waited for. */
static void tell_restore(struct intake *intake, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                         bool taken, uint16_t due) {
    int passed = (int16_t)(intake->reorder.next - due);

    if (passed < 0 || passed > REORDER_JUMP)
        begin_repair(intake);
    if (taken || (uint16_t)(intake->restore.newest - packet->sequence) < REPAIR_PACKETS)
        restore_source(&intake->restore, data, size);
    if (passed)
        restore_give_up(&intake->restore, intake->reorder.next);
    count_repair(intake);
}

/* ---- Choice of the source ---- */

static void follow(struct intake *intake, const struct rtp_packet *packet, int64_t now) {
    intake->followed = true;
    intake->confirmed = false;
    intake->ssrc = packet->ssrc;
    intake->window = 0;
    intake->type = packet->type;
    intake->heard = now;
    intake->queued = 0;
    intake->in_sequence = false;
    assembly_begin(&intake->assembly);
    intake->count[INTAKE_SOURCES]++;
    reorder_init(&intake->reorder);
    begin_repair(intake);
}

/* Keeps a packet of another source, and follows that source if the conditions hold. */
static void hear_other(struct intake *intake, const struct rtp_packet *packet, const uint8_t *data, size_t size,
                       int64_t now) {
    bool known = intake->queued && intake->other == packet->ssrc;

    intake->count[INTAKE_FOREIGN]++;
    if (!known) {
        if (intake->queued && intake->in_sequence && now - intake->other_heard < INTAKE_SILENCE)
            return; /* a stray packet does not replace a source that still sends */
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

static bool put(struct intake *intake, const struct rtp_packet *packet, const uint8_t *data, size_t size, int64_t now,
                bool restored) {
    uint16_t due = intake->reorder.next;
    enum reorder_result result = reorder_put(&intake->reorder, packet->sequence, data, size, now);
    bool taken = result == REORDER_TAKEN || result == REORDER_OUT_OF_TURN;

    switch (result) {
    case REORDER_TAKEN: break;
    case REORDER_OUT_OF_TURN: intake->count[INTAKE_REORDERED] += !restored; break;
    case REORDER_DUPLICATE: intake->count[INTAKE_DUPLICATE]++; break;
    case REORDER_LATE: intake->count[INTAKE_LATE]++; break;
    case REORDER_FULL:
        slot_fill(&intake->held, data, size, now);
        intake->held_restored = restored;
        return true;
    }
    if (result == REORDER_TAKEN && packet->has_count) {
        intake->newest = packet->frame.count;
        intake->window = packet->frame.window;
    }
    if (!restored)
        tell_restore(intake, packet, data, size, taken, due);
    return taken;
}

bool intake_put(struct intake *intake, const uint8_t *data, size_t size, int64_t now) {
    struct rtp_packet packet;

    intake->count[INTAKE_RECEIVED]++;
    intake->count[INTAKE_BYTES] += size;
    if (size > RTP_DATAGRAM_MAX || !rtp_parse(data, size, &packet)) {
        intake->count[INTAKE_GARBAGE]++;
        return false;
    }
    if (packet.type != RTP_H264 && packet.type != RTP_MPEG4) {
        intake->count[INTAKE_FOREIGN]++;
        return false;
    }
    if (!intake->followed) {
        follow(intake, &packet, now);
    } else if (packet.ssrc != intake->ssrc) {
        hear_other(intake, &packet, data, size, now);
        return false;
    } else if (packet.type != intake->type) {
        intake->count[INTAKE_FOREIGN]++;
        return false;
    } else {
        intake->confirmed = true;
        intake->queued = 0;
    }
    intake->heard = now;
    return put(intake, &packet, data, size, now, false);
}

static void put_slot(struct intake *intake, struct reorder_slot *slot, bool restored) {
    struct rtp_packet packet;

    slot->used = false;
    rtp_parse(slot->data, slot->size, &packet);
    put(intake, &packet, slot->data, slot->size, slot->arrival, restored);
}

/* Puts a restored packet into its place; its content is as credible as the repair packets. */
static void put_restored(struct intake *intake, const uint8_t *data, size_t size, int64_t now) {
    struct rtp_packet packet;

    if (!rtp_parse(data, size, &packet) || packet.type != intake->type)
        intake->count[INTAKE_GARBAGE]++;
    else
        put(intake, &packet, data, size, now, true);
}

/* Follow the other source: its packets are taken out of the queue by put_next(). */
static void switch_over(struct intake *intake) {
    struct rtp_packet packet;
    unsigned queued = intake->queued;

    rtp_parse(intake->queue[0].data, intake->queue[0].size, &packet);
    follow(intake, &packet, intake->queue[queued - 1].arrival);
    intake->confirmed = true;
    intake->switching = false;
    intake->count[INTAKE_FOREIGN] -= queued; /* the queued packets are of the new source */
    intake->queued = queued;
    intake->taken = 0;
    intake->replaying = true;
}

/* Puts packets that have a place now: the datagram that had none, and restored packets. False if there is none. */
static bool put_waiting(struct intake *intake, int64_t now) {
    const uint8_t *data;
    size_t size;
    uint16_t sequence;

    if (intake->held.used) {
        put_slot(intake, &intake->held, intake->held_restored);
        return !intake->held.used;
    }
    if (!restore_take(&intake->restore, &data, &size, &sequence))
        return false;
    put_restored(intake, data, size, now);
    return true;
}

/* Puts the waiting datagram, once all earlier packets are out. False if none waits. */
static bool put_next(struct intake *intake) {
    if (intake->switching)
        switch_over(intake);
    else if (intake->replaying && intake->taken < intake->queued)
        put_slot(intake, &intake->queue[intake->taken++], false);
    else if (intake->replaying) {
        intake->replaying = false;
        intake->queued = 0;
    } else
        return false;
    return true;
}

/* ---- Gaps ---- */

static bool is_repairing(const struct intake *intake) {
    return intake->repairs && intake->window;
}

/* Whether the sender's window has passed the packet that is due. */
static bool is_out_of_window(const struct intake *intake) {
    return (int16_t)(intake->newest - assembly_due(&intake->assembly)) > intake->window ||
           rtp_after(intake->restore.floor, intake->reorder.next);
}

/* Gives up the packet that is due if it can no longer arrive in time. */
static bool give_up(struct intake *intake, int64_t now) {
    bool hopeless = intake->held.used || intake->switching || now >= intake_deadline(intake) ||
                    (is_repairing(intake) && is_out_of_window(intake));

    if (!hopeless || !reorder_give_up(&intake->reorder))
        return false;
    restore_give_up(&intake->restore, intake->reorder.next);
    count_repair(intake);
    return true;
}

int64_t intake_deadline(const struct intake *intake) {
    int64_t since = reorder_waits_since(&intake->reorder);
    int64_t patience = is_repairing(intake) ? INTAKE_REPAIR : intake->patience;

    return since > INT64_MAX - patience ? INT64_MAX : since + patience;
}

/* ---- Frames ---- */

/* Takes the packet that is due. Whether it completes a frame: its own, or the previous one, if it begins the next. */
static bool take_packet(struct intake *intake, const struct reorder_slot *slot, unsigned lost,
                        struct assembly_frame *frame) {
    struct rtp_packet packet;

    rtp_parse(slot->data, slot->size, &packet);
    if (assembly_is_next(&intake->assembly, &packet))
        return assembly_close(&intake->assembly, true, frame);
    bool good = assembly_add(&intake->assembly, &packet, lost, slot->arrival);
    intake->count[good ? INTAKE_USED : INTAKE_GARBAGE]++;
    intake->count[INTAKE_LOST] += lost;
    reorder_take(&intake->reorder);
    return packet.marker && assembly_close(&intake->assembly, false, frame);
}

bool intake_take(struct intake *intake, int64_t now, struct assembly_frame *frame) {
    for (;;) {
        unsigned lost;
        const struct reorder_slot *slot = reorder_peek(&intake->reorder, &lost);

        if (slot) {
            if (take_packet(intake, slot, lost, frame))
                return true;
        } else if (!put_waiting(intake, now) && !give_up(intake, now)) {
            if (intake->switching && assembly_close(&intake->assembly, true, frame))
                return true; /* the end of the former source's last frame */
            if (!put_next(intake))
                return false;
        }
    }
}

bool intake_take_last(struct intake *intake, struct assembly_frame *frame) {
    return intake_take(intake, INT64_MAX, frame) || assembly_close(&intake->assembly, true, frame);
}
