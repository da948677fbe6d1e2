/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "report.h"

#include <errno.h>

#include "bits.h"

#define VERSION 0x80
#define PADDING 0x20
#define FEEDBACK 206 /* payload type: feedback about the payload */
#define LOSS_INDICATION 1
#define APPLICATION 15
#define MAGIC 0x44445831u /* DDX1 */
#define HEADER 4
#define FEEDBACK_BYTES 12 /* the header and both SSRCs */
#define HAS_REPAIR 1

static uint8_t *put_header(uint8_t *to, uint8_t format, size_t size, const struct report *report) {
    *to++ = VERSION | format;
    *to++ = FEEDBACK;
    to = put16(to, (uint16_t)(size / 4 - 1));
    to = put32(to, report->reporter);
    return put32(to, report->media);
}

static uint16_t ticks_of(int64_t age) {
    return age < 0 ? 0 : age >= REPORT_OLDEST_NS ? UINT16_MAX : (uint16_t)(age / REPORT_TICK_NS);
}

static uint8_t *put_state(uint8_t *to, const struct report *report) {
    to = put_header(to, APPLICATION, REPORT_SIZE, report);
    to = put32(to, MAGIC);
    to = put16(to, report->highest);
    to = put16(to, report->base);
    to = put16(to, report->missing);
    *to++ = report->loss;
    *to++ = report->has_repair ? HAS_REPAIR : 0;
    to = put16(to, report->has_repair ? report->highest_repair : 0);
    to = put16(to, ticks_of(report->age));
    return put32(to, 0);
}

size_t report_write(uint8_t *to, const struct report *report) {
    uint8_t *at = to;

    if (report->has_state)
        at = put_state(at, report);
    if (report->refresh)
        at = put_header(at, LOSS_INDICATION, FEEDBACK_BYTES, report);
    return (size_t)(at - to);
}

static bool is_possible(const struct report *report) {
    unsigned known = (uint16_t)(report->highest + 1 - report->base);

    return known <= REPORT_WINDOW && report->missing <= known;
}

static int parse_state(const uint8_t *data, size_t size, struct report *report) {
    if (size < REPORT_SIZE || get32(data + 12) != MAGIC) /* another program's application */
        return 0;
    if (report->has_state)
        return -EBADMSG;
    report->has_state = true;
    report->highest = get16(data + 16);
    report->base = get16(data + 18);
    report->missing = get16(data + 20);
    report->loss = data[22];
    report->has_repair = data[23] & HAS_REPAIR;
    report->highest_repair = get16(data + 24);
    report->age = get16(data + 26) * REPORT_TICK_NS;
    return is_possible(report) ? 0 : -EBADMSG;
}

static int parse_feedback(const uint8_t *data, size_t size, struct report *report) {
    struct report before = *report;
    uint8_t format = data[0] & 31;
    int error = 0;

    if (size < FEEDBACK_BYTES)
        return -EBADMSG;
    if (format == APPLICATION)
        error = parse_state(data, size, report);
    else if (format == LOSS_INDICATION)
        report->refresh = true;
    if (error || (report->has_state == before.has_state && report->refresh == before.refresh))
        return error;
    report->reporter = get32(data + 4);
    report->media = get32(data + 8);
    bool first = !before.has_state && !before.refresh;
    return first || (report->reporter == before.reporter && report->media == before.media) ? 0 : -EBADMSG;
}

/* The bytes of the RTCP packet at the start, 0 if it is none. Only the last one of a datagram may be padded. */
static size_t packet_size(const uint8_t *data, size_t size, size_t *content) {
    if (size < HEADER || data[0] >> 6 != 2 || data[1] < 192 || data[1] > 223)
        return 0;
    size_t bytes = 4u * (get16(data + 2) + 1u);
    if (bytes > size)
        return 0;
    *content = bytes;
    if (!(data[0] & PADDING))
        return bytes;
    unsigned padding = data[bytes - 1];
    if (bytes != size || !padding || padding % 4 || padding > bytes - HEADER)
        return 0;
    *content = bytes - padding;
    return bytes;
}

int report_parse(const uint8_t *data, size_t size, struct report *report) {
    *report = (struct report){0};
    if (!size)
        return -EBADMSG;
    while (size) {
        size_t content, bytes = packet_size(data, size, &content);
        int error = bytes ? 0 : -EBADMSG;

        if (!error && data[1] == FEEDBACK)
            error = parse_feedback(data, content, report);
        if (error)
            return error;
        data += bytes;
        size -= bytes;
    }
    return report->has_state || report->refresh ? 0 : -ENOMSG;
}
