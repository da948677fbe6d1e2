/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "rtp.h"

#include "bits.h"
#include "ddx_time.h"

#define VERSION 0x80
#define PADDING 0x20
#define EXTENSION 0x10
#define FIXED 12        /* bytes of the header that every packet has */
#define ONE_BYTE 0xBEDE /* RFC 8285: elements with headers of one byte */
#define ID_CAPTURE 1
#define ID_FRAME 2
#define ID_SOURCE 3
#define CAPTURE_BYTES 8
#define FRAME_BYTES 3
#define SOURCE_BYTES 8
#define ENCRYPTED 0x80 /* of the third byte of ID_FRAME */
#define ELEMENT(id, bytes) ((uint8_t)((id) << 4 | ((bytes)-1)))

#define NTP_EPOCH INT64_C(2208988800) /* s from 1900 to 1970 */

static uint64_t ntp_of(int64_t ns) {
    uint64_t seconds = (uint64_t)(ns / SECOND + NTP_EPOCH), rest = (uint64_t)ns % SECOND;

    return seconds << 32 | ((rest << 32) + SECOND / 2) / SECOND;
}

static int64_t ns_of(uint64_t ntp) {
    int64_t seconds = (int64_t)(ntp >> 32) - NTP_EPOCH;

    return seconds * SECOND + (int64_t)(((ntp & UINT32_MAX) * SECOND + (UINT64_C(1) << 31)) >> 32);
}

/* Further data in the first packet of a frame, and two bytes of padding: 20 bytes. */
static uint8_t *write_source(uint8_t *at, const struct rtp_frame *frame) {
    uint64_t ntp = ntp_of(frame->capture);

    *at++ = ELEMENT(ID_CAPTURE, CAPTURE_BYTES);
    at = put32(at, (uint32_t)(ntp >> 32));
    at = put32(at, (uint32_t)ntp);
    *at++ = ELEMENT(ID_SOURCE, SOURCE_BYTES);
    at = put32(at, frame->sequence);
    at = put32(at, frame->number);
    return put16(at, 0);
}

size_t rtp_write(uint8_t *to, const struct rtp_packet *packet) {
    uint8_t *at = to;

    *at++ = packet->has_count ? VERSION | EXTENSION : VERSION;
    *at++ = (uint8_t)(packet->marker << 7 | packet->type);
    at = put16(at, packet->sequence);
    at = put32(at, packet->time);
    at = put32(at, packet->ssrc);
    if (!packet->has_count)
        return (size_t)(at - to);
    at = put16(at, ONE_BYTE);
    at = put16(at, packet->has_source ? 6 : 1); /* length in units of 4 bytes */
    *at++ = ELEMENT(ID_FRAME, FRAME_BYTES);
    at = put16(at, packet->frame.count);
    *at++ = (uint8_t)(packet->frame.window | (packet->frame.encrypted ? ENCRYPTED : 0));
    if (packet->has_source)
        at = write_source(at, &packet->frame);
    return (size_t)(at - to);
}

/* Reads the elements of the extension; skips unknown ones, and stops at one that does not fit. */
static void parse_elements(const uint8_t *at, const uint8_t *end, struct rtp_packet *packet) {
    bool captured = false, numbered = false;

    while (at < end) {
        uint8_t id = *at >> 4;
        size_t bytes = (*at & 15) + 1u;

        if (!*at++) /* padding */
            continue;
        if (id == 15 || bytes > (size_t)(end - at))
            break;
        if (id == ID_CAPTURE && bytes == CAPTURE_BYTES) {
            packet->frame.capture = ns_of((uint64_t)get32(at) << 32 | get32(at + 4));
            captured = true;
        } else if (id == ID_FRAME && bytes == FRAME_BYTES) {
            packet->frame.count = get16(at);
            packet->frame.encrypted = at[2] & ENCRYPTED;
            packet->frame.window = (uint8_t)(at[2] & ~ENCRYPTED);
            packet->has_count = true;
        } else if (id == ID_SOURCE && bytes == SOURCE_BYTES) {
            packet->frame.sequence = get32(at);
            packet->frame.number = get32(at + 4);
            numbered = true;
        }
        at += bytes;
    }
    packet->has_source = packet->has_count && captured && numbered;
}

bool rtp_parse(const uint8_t *data, size_t size, struct rtp_packet *packet) {
    const uint8_t *end = data + size;

    if (size < FIXED || data[0] >> 6 != 2)
        return false;
    *packet = (struct rtp_packet){.type = data[1] & 0x7f,
                                  .marker = data[1] >> 7,
                                  .sequence = get16(data + 2),
                                  .time = get32(data + 4),
                                  .ssrc = get32(data + 8)};
    size_t header = FIXED + 4u * (data[0] & 15); /* contributing sources */
    if (header > size)
        return false;
    const uint8_t *at = data + header;
    if (data[0] & EXTENSION) {
        if (end - at < 4)
            return false;
        size_t bytes = 4u * get16(at + 2);
        if (bytes > (size_t)(end - at - 4))
            return false;
        if (get16(at) == ONE_BYTE)
            parse_elements(at + 4, at + 4 + bytes, packet);
        at += 4 + bytes;
    }
    if (data[0] & PADDING) {
        if (at == end || !end[-1] || end[-1] > end - at)
            return false;
        end -= end[-1];
    }
    packet->payload = at;
    packet->size = (size_t)(end - at);
    return packet->size > 0;
}
