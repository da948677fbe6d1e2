/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "assembly.h"

void assembly_begin(struct assembly *assembly) {
    *assembly = (struct assembly){.chunk = assembly->chunk, .fresh = true};
}

void assembly_free(struct assembly *assembly) {
    chunk_free(&assembly->chunk);
}

bool assembly_is_next(const struct assembly *assembly, const struct rtp_packet *packet) {
    return assembly->open && packet->time != assembly->frame.time;
}

uint16_t assembly_due(const struct assembly *assembly) {
    return assembly->open ? assembly->frame.frame.count : assembly->expected;
}

static void open_frame(struct assembly *assembly, const struct rtp_packet *packet) {
    assembly->chunk.size = 0;
    assembly->open = true;
    assembly->frame = (struct assembly_frame){.type = (enum rtp_type)packet->type,
                                              .first = assembly->fresh,
                                              .incomplete = packet->has_count && !packet->has_source,
                                              .damaged = packet->has_count && !assembly->fresh &&
                                                         packet->frame.count != assembly->expected,
                                              .time = packet->time,
                                              .has_count = packet->has_count,
                                              .has_source = packet->has_source,
                                              .frame = packet->frame};
    if (packet->has_count && !assembly->fresh)
        assembly->frame.missing = (uint16_t)(packet->frame.count - assembly->expected);
    if (assembly->frame.missing > INT16_MAX)
        assembly->frame.missing = 0; /* the sender's count went back */
    assembly->expected = (uint16_t)(packet->frame.count + 1);
}

/*
 * The first packet of the frame is missing. RTP times are capture times, so the time is exact to a unit of RTP's clock.
 * The numbers are correct if the sender has left out no frame since the last one with known numbers.
 */
static void derive(struct assembly *assembly, struct assembly_frame *frame) {
    int64_t ticks = (int32_t)(frame->time - assembly->known.time);
    int frames = (int16_t)(frame->frame.count - assembly->known.frame.count);

    frame->has_source = frame->derived = true;
    frame->frame.capture = assembly->known.frame.capture + ticks * 1000000000 / RTP_CLOCK;
    frame->frame.sequence = assembly->known.frame.sequence + (uint32_t)frames;
    frame->frame.number = assembly->known.frame.number + (uint32_t)frames;
}

static void complete_numbers(struct assembly *assembly, struct assembly_frame *frame) {
    if (frame->has_source) {
        assembly->known.there = true;
        assembly->known.time = frame->time;
        assembly->known.frame = frame->frame;
    } else if (frame->has_count && assembly->known.there) {
        derive(assembly, frame);
    }
}

bool assembly_close(struct assembly *assembly, bool cut, struct assembly_frame *frame) {
    if (!assembly->open)
        return false;
    assembly->open = assembly->fresh = false;
    h264_unpack_end(&assembly->h264, &assembly->chunk);
    *frame = assembly->frame;
    frame->data = assembly->chunk.data;
    frame->size = assembly->chunk.size;
    if (frame->data)
        chunk_pad(&assembly->chunk);
    complete_numbers(assembly, frame);
    frame->incomplete |= cut;
    frame->damaged |= cut;
    return true;
}

bool assembly_add(struct assembly *assembly, const struct rtp_packet *packet, unsigned lost, int64_t arrival) {
    struct chunk *chunk = &assembly->chunk;
    bool begins = !assembly->open;

    if (begins)
        open_frame(assembly, packet);
    bool good = packet->type == RTP_H264
                    ? h264_unpack(&assembly->h264, chunk, packet->payload, packet->size, lost > 0)
                    : mpeg4_unpack(&assembly->mpeg4, chunk, packet->payload, packet->size, lost > 0);
    assembly->frame.incomplete |= !good || (lost && !(begins && packet->has_source));
    assembly->frame.damaged |= lost || assembly->frame.incomplete;
    assembly->frame.arrival = arrival;
    return good;
}
