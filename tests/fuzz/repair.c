/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Fuzz target: media and repair packets into the receiver of repair. The input is a sequence of commands, each a byte:
 * its low three bits are the command, the others a number n. Bytes and packets of the input follow where noted; a
 * packet is a byte for its size (times five), and its bytes.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "bits.h"
#include "restore.h"

#define SSRC 0x1001u

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum command {
    SEND,    /* a media packet: delivered unless n is odd */
    REPAIR,  /* a repair packet for the last n + 1 packets, delivered */
    CHANGE,  /* the same, but the byte at (2 bytes) is changed (1 byte) */
    FORGE,   /* a packet as the payload of a repair packet for the last n packets and 4 more */
    REPAIRS, /* a packet, as a repair packet */
    SOURCE,  /* a packet, as a media packet */
    GIVE_UP, /* all but the last n */
    LATE     /* the packet that was sent before the last n */
};

static struct restore receiver;
static struct repair_window window;
static uint32_t next;
static bool honest; /* no packet was changed or forged: restored packets must be right */

struct input {
    const uint8_t *at, *end;
};

static uint8_t take_byte(struct input *input) {
    return input->at < input->end ? *input->at++ : 0;
}

static size_t media_of(uint32_t esi, uint8_t *to) {
    struct rtp_packet packet = {.type = RTP_H264, .sequence = (uint16_t)esi, .time = esi, .ssrc = SSRC};
    size_t header = rtp_write(to, &packet), size = header + 1 + esi * 7 % 40;

    memset(to + header, (int)(esi & 255), size - header);
    return size;
}

/* Delivers the packet from memory of exactly its size. */
static void deliver(const uint8_t *packet, size_t size, bool repair) {
    uint8_t *copy = malloc(size ? size : 1);

    memcpy(copy, packet, size);
    if (repair)
        restore_repair(&receiver, copy, size);
    else
        restore_source(&receiver, copy, size);
    free(copy);
}

/* Takes and checks each restored packet. */
static void take_all(void) {
    const uint8_t *packet;
    uint8_t copy[RTP_DATAGRAM_MAX], expected[RTP_PACKET_MAX];
    size_t size;
    uint16_t sequence;
    struct rtp_packet rtp;

    while (restore_take(&receiver, &packet, &size, &sequence)) {
        assert(size <= RTP_DATAGRAM_MAX);
        memcpy(copy, packet, size);
        assert(rtp_parse(copy, size, &rtp) && rtp.ssrc == SSRC && rtp.sequence == sequence);
        assert(!honest ||
               (size == media_of(next - (uint16_t)(next - sequence), expected) && !memcmp(copy, expected, size)));
    }
}

static void check_counts(void) {
    const uint64_t *count = receiver.count;
    unsigned missing;
    uint16_t base, highest;

    assert(count[RESTORE_RECEIVED] == count[RESTORE_REFUSED] + count[RESTORE_USELESS] + count[RESTORE_EXPIRED] +
                                          count[RESTORE_CORRUPT] + count[RESTORE_RESTORED] + receiver.rows);
    assert(!honest || !(count[RESTORE_CORRUPT] + receiver.wrong));
    if (restore_missing(&receiver, &missing, &base, &highest))
        assert(missing + receiver.rows <= (uint16_t)(highest + 1 - base));
}

static void send_media(unsigned n) {
    uint8_t packet[RTP_PACKET_MAX];
    size_t size = media_of(next, packet);

    repair_window_add(&window, next, (uint16_t)(next / 2), packet, size);
    next++;
    if (!(n & 1))
        deliver(packet, size, false);
}

static void send_repair(struct input *input, unsigned n, bool change) {
    uint8_t packet[REPAIR_MAX];
    size_t size = repair_make(&window, next - 1 - n, packet);

    if (change && size) {
        size_t at = take_byte(input);

        at = at << 8 | take_byte(input);
        packet[at % size] = take_byte(input);
        honest = false;
    }
    deliver(packet, size, true);
}

static void send_packet(struct input *input, enum command command, unsigned n) {
    uint8_t packet[REPAIR_HEADER + 255 * 5];
    size_t size = take_byte(input) * 5u, header = command == FORGE ? REPAIR_HEADER : 0;

    if (size > (size_t)(input->end - input->at))
        size = (size_t)(input->end - input->at);
    if (header && repair_make(&window, next - n, packet))
        put16(packet + 18, (uint16_t)(0xf000 + n + 4));
    memcpy(packet + header, input->at, size);
    input->at += size;
    honest = false;
    deliver(packet, header + size, command != SOURCE);
}

static void step(struct input *input) {
    uint8_t byte = take_byte(input);
    unsigned n = byte >> 3;
    uint8_t packet[RTP_PACKET_MAX];

    switch ((enum command)(byte & 7)) {
    case SEND: send_media(n); break;
    case REPAIR: send_repair(input, n, false); break;
    case CHANGE: send_repair(input, n, true); break;
    case FORGE:
    case REPAIRS:
    case SOURCE: send_packet(input, (enum command)(byte & 7), n); break;
    case GIVE_UP: restore_give_up(&receiver, (uint16_t)(next - n)); break;
    case LATE: deliver(packet, media_of(next - 1 - n, packet), false); break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct input input = {data, data + size};

    next = 65526;
    honest = true;
    restore_clear(&receiver);
    memset(&receiver, 0xa5, sizeof receiver); /* an input must always have the same effect */
    restore_init(&receiver, SSRC);
    repair_window_init(&window, SSRC, 0x2002, 1);
    send_media(0);
    while (input.at < input.end) {
        step(&input);
        take_all();
        check_counts();
    }
    return 0;
}
