/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "packets.h"

#include <string.h>

struct source {
    struct h264_packer h264;
    struct mpeg4_packer *mpeg4;
};

static void begin(struct source *source, uint8_t type, const struct encoded *encoded) {
    if (type == RTP_H264)
        h264_pack(&source->h264, encoded->data, encoded->size);
    else
        mpeg4_pack(source->mpeg4, encoded->data, encoded->size);
}

static size_t next(struct source *source, uint8_t type, uint8_t *to, bool *last) {
    return type == RTP_H264 ? h264_pack_next(&source->h264, to, last) : mpeg4_pack_next(source->mpeg4, to, last);
}

bool packets_make(struct packets *packets, const struct encoded *encoded, struct rtp_packet packet) {
    struct source source = {.mpeg4 = &packets->mpeg4};
    uint8_t payload[RTP_ROOM];
    uint16_t sequence = packets->sequence;
    size_t size;

    packets->count = 0;
    packet.has_count = packet.has_source = true;
    begin(&source, packet.type, encoded);
    while ((size = next(&source, packet.type, payload, &packet.marker))) {
        if (packets->count == STREAM_TX_QUEUE)
            return false;
        uint8_t *data = packets->data[packets->count];
        packet.sequence = sequence++;
        size_t header = rtp_write(data, &packet);
        memcpy(data + header, payload, size);
        packets->packet[packets->count++] = (struct stream_tx_packet){data, header + size};
        packet.has_source = false; /* once a frame, in its first packet */
    }
    packets->sequence = sequence;
    return true;
}
