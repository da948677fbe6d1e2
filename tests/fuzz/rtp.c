/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: datagrams into the intake (RTP, order, repair, H.264 and MPEG-4 payloads). The input is a sequence of
 * them: a byte for the milliseconds since the last one, two for the size, of which the highest bit is the port (1:
 * that of repair packets), then the datagram.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "intake.h"

#define MS INT64_C(1000000)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Reads every byte of a frame, so that the sanitizer sees undefined ones. */
static unsigned look_at(const struct assembly_frame *frame) {
    unsigned sum = 0;
    assert(frame->type == RTP_H264 || frame->type == RTP_MPEG4);
    assert(!frame->size || frame->data);
    for (size_t i = 0; frame->size && i < frame->size + CHUNK_PADDING; i++)
        sum += frame->data[i];
    struct mpeg4_vol vol;
    for (const uint8_t *at = frame->data; frame->size && mpeg4_next_vol(&at, frame->data + frame->size, &vol);)
        sum += vol.width + vol.height;
    return sum + (frame->size && mpeg4_is_studio(frame->data, frame->size));
}

static void take_all(struct intake *intake, int64_t now) {
    static volatile unsigned sum;
    struct assembly_frame frame;
    while (intake_take(intake, now, &frame))
        sum = sum + look_at(&frame);
}

/* Each packet is counted exactly once. */
static void check_counts(const struct intake *intake) {
    const uint64_t *count = intake->count;
    uint64_t known = count[INTAKE_USED] + count[INTAKE_LATE] + count[INTAKE_DUPLICATE] + count[INTAKE_FOREIGN] +
                     count[INTAKE_GARBAGE] + intake->reorder.waiting;
    assert(count[INTAKE_RECEIVED] + count[INTAKE_RESTORED] == known);
    known = count[INTAKE_RESTORED] + count[INTAKE_REPAIR_REFUSED] + count[INTAKE_REPAIR_USELESS] +
            count[INTAKE_REPAIR_EXPIRED] + count[INTAKE_REPAIR_CORRUPT] + intake->restore.rows;
    assert(count[INTAKE_REPAIR_RECEIVED] == known);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct intake intake;
    int64_t now = MS;
    intake_init(&intake, 20 * MS, true);
    while (size >= 3) {
        bool repair = data[1] >> 7;
        size_t bytes = (size_t)((data[1] & 0x7f) << 8 | data[2]) % (RTP_DATAGRAM_MAX + 8);
        now += data[0] * MS;
        data += 3;
        size -= 3;
        if (bytes > size)
            bytes = size;
        uint8_t *datagram = malloc(bytes ? bytes : 1); /* exactly its size */
        memcpy(datagram, data, bytes);
        if (repair)
            intake_put_repair(&intake, datagram, bytes);
        else
            intake_put(&intake, datagram, bytes, now);
        free(datagram);
        take_all(&intake, now);
        check_counts(&intake);
        data += bytes;
        size -= bytes;
    }
    struct assembly_frame last;
    while (intake_take_last(&intake, &last))
        look_at(&last);
    check_counts(&intake);
    assert(!intake.reorder.waiting);
    intake_free(&intake);
    return 0;
}
