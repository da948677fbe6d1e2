/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: datagrams into stream_rx.h (RTP, order, repair, H.264 and MPEG-4 payloads). The input is a sequence of
 * them: a byte for the milliseconds since the last one, two for the size, of which the highest bit is the port (1:
 * that of repair packets), then the datagram.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "stream_rx.h"

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

static void take_all(struct stream_rx *rx, int64_t now) {
    static volatile unsigned sum;
    struct assembly_frame frame;
    while (stream_rx_take(rx, now, &frame))
        sum = sum + look_at(&frame);
}

/* Each packet is counted exactly once. */
static void check_counts(const struct stream_rx *rx) {
    const uint64_t *count = rx->count;
    uint64_t known = count[STREAM_RX_USED] + count[STREAM_RX_LATE] + count[STREAM_RX_DUPLICATE] +
                     count[STREAM_RX_FOREIGN] + count[STREAM_RX_GARBAGE] + rx->reorder.waiting;
    assert(count[STREAM_RX_RECEIVED] + count[STREAM_RX_RESTORED] == known);
    known = count[STREAM_RX_RESTORED] + count[STREAM_RX_REPAIR_REFUSED] + count[STREAM_RX_REPAIR_USELESS] +
            count[STREAM_RX_REPAIR_EXPIRED] + count[STREAM_RX_REPAIR_CORRUPT] + rx->restore.rows;
    assert(count[STREAM_RX_REPAIR_RECEIVED] == known);
}

/* A sender accepts each report, and none is due at once again. */
static void check_reports(struct stream_rx *rx, int64_t now) {
    uint8_t data[REPORT_MAX];
    struct report report;
    size_t size = stream_rx_report(rx, now, now / MS % 2, data);
    assert(!size || !report_parse(data, size, &report));
    assert(stream_rx_report_deadline(rx) > now);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct stream_rx rx;
    int64_t now = MS;
    stream_rx_init(&rx, &(struct stream_rx_settings){20 * MS, true, true, 77});
    rx.report_header = 28;
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
            stream_rx_put_repair(&rx, datagram, bytes, now);
        else
            stream_rx_put(&rx, datagram, bytes, now);
        free(datagram);
        take_all(&rx, now);
        check_counts(&rx);
        check_reports(&rx, now);
        data += bytes;
        size -= bytes;
    }
    struct assembly_frame last;
    while (stream_rx_take_last(&rx, &last))
        look_at(&last);
    check_counts(&rx);
    assert(!rx.reorder.waiting);
    stream_rx_free(&rx);
    return 0;
}
