/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "ts.h"

#ifdef WITH_AVFORMAT
#include <libavformat/avformat.h>
#include <string.h>

#include "payload.h"

#define PACKET 188           /* bytes of a packet of MPEG-TS */
#define PAYLOAD (7 * PACKET) /* in an RTP packet: as usual, and within an Ethernet frame */
#define HEADER 12
#define LEAD 90000 /* 90 kHz: the first frame's time */

#if LIBAVFORMAT_VERSION_MAJOR >= 61
#define BYTES const uint8_t
#else
#define BYTES uint8_t
#endif

bool ts_is_possible(void) {
    return av_guess_format("mpegts", NULL, NULL);
}

/* Send the bytes that the muxer has written, at most PAYLOAD, as an RTP packet. */
static int send_packet(void *opaque, BYTES *data, int size) {
    struct ts *ts = opaque;
    const struct rtp_packet head = {.type = RTP_TS, .sequence = ts->sequence++, .time = ts->time, .ssrc = ts->ssrc};
    uint8_t packet[HEADER + PAYLOAD];
    size_t length = rtp_write(packet, &head);

    if ((size_t)size > sizeof packet - length)
        return AVERROR(EINVAL);
    memcpy(packet + length, data, (size_t)size);
    length += (size_t)size;
    if (!post_other(ts->post, length + ts->post->tx.settings.header)) {
        ts->lost += ts->outlet.receivers;
        return size;
    }
    for (unsigned missed = outlet_send(&ts->outlet, OUTLET_MEDIA, packet, length); missed; missed &= missed - 1)
        ts->lost++;
    return size;
}

/* Two receivers at one address share a port here. */
static void take_receivers(struct ts *ts, const struct outlet *outlet) {
    struct outlet *to = &ts->outlet;

    *to = *outlet;
    to->packets = to->bytes = 0;
    to->receivers = 0;
    for (unsigned i = 0; i < outlet->receivers; i++) {
        struct network_address *address = &to->receiver[to->receivers];
        unsigned same = 0;

        *address = outlet->receiver[i];
        network_set_port(address, (uint16_t)ts->port);
        while (memcmp(&to->receiver[same], address, sizeof *address) != 0)
            same++;
        to->receivers += same == to->receivers;
    }
}

static AVIOContext *open_output(struct ts *ts) {
    uint8_t *buffer = av_malloc(PAYLOAD);
    AVIOContext *output = buffer ? avio_alloc_context(buffer, PAYLOAD, 1, ts, NULL, send_packet, NULL) : NULL;

    if (!output)
        av_free(buffer);
    return output;
}

/*
 * A player that joins needs the tables first (pat_period, s). With the length of each frame in its head (PES), the
 * player need not wait for the next frame to know the end of this one.
 */
static int begin(struct ts *ts, const char *name) {
    AVDictionary *options = NULL;

    av_dict_set(&options, "pat_period", "0.3", 0);
    av_dict_set(&options, "sdt_period", "2", 0);
    av_dict_set(&options, "omit_video_pes_length", "0", 0);
    av_dict_set(&ts->muxer->metadata, "service_name", name, 0);
    av_dict_set(&ts->muxer->metadata, "service_provider", "DDXVIDEO", 0);
    ts->muxer->flags |= AVFMT_FLAG_FLUSH_PACKETS | AVFMT_FLAG_CUSTOM_IO;
    ts->muxer->max_delay = 0;
    int error = avformat_write_header(ts->muxer, &options);
    if (error >= 0 && av_dict_count(options)) /* otherwise a player waits longer than the documentation says */
        error = AVERROR_OPTION_NOT_FOUND;
    av_dict_free(&options);
    return error < 0 ? error : 0;
}

int ts_open(struct ts *ts, struct post *post, enum rtp_type type, const char *name) {
    int error = avformat_alloc_output_context2(&ts->muxer, NULL, "mpegts", NULL);

    if (error < 0)
        return error;
    ts->post = post;
    take_receivers(ts, post->outlet);
    AVStream *stream = avformat_new_stream(ts->muxer, NULL);
    ts->packet = av_packet_alloc();
    ts->muxer->pb = open_output(ts);
    if (!stream || !ts->packet || !ts->muxer->pb)
        return AVERROR(ENOMEM);
    stream->codecpar->codec_type = AVMEDIA_TYPE_VIDEO;
    stream->codecpar->codec_id = type == RTP_H264 ? AV_CODEC_ID_H264 : AV_CODEC_ID_MPEG4;
    ts->type = type;
    ts->last = -1;
    return begin(ts, name);
}

void ts_close(struct ts *ts) {
    if (ts->muxer && ts->muxer->pb) {
        av_freep(&ts->muxer->pb->buffer);
        avio_context_free(&ts->muxer->pb);
    }
    avformat_free_context(ts->muxer);
    ts->muxer = NULL;
    av_packet_free(&ts->packet);
}

/* Times rise: two frames of the same moment get different times. */
static int64_t next_time(struct ts *ts, int64_t time) {
    if (ts->last < 0)
        ts->first = time;
    int64_t at = LEAD + av_rescale(time - ts->first, RTP_CLOCK, 1000000000);
    if (at <= ts->last)
        at = ts->last + 1;
    return ts->last = at;
}

void ts_send(struct ts *ts, const uint8_t *data, size_t size, int64_t time) {
    AVPacket *packet = ts->packet;

    if (!ts->muxer)
        return;
    packet->data = (uint8_t *)(uintptr_t)data;
    packet->size = (int)size;
    packet->pts = packet->dts = next_time(ts, time);
    packet->flags = codec_can_begin(ts->type, data, size) ? AV_PKT_FLAG_KEY : 0;
    ts->time = (uint32_t)packet->pts;
    av_write_frame(ts->muxer, packet);
}

#else

bool ts_is_possible(void) {
    return false;
}

int ts_open(struct ts *ts, struct post *post, enum rtp_type type, const char *name) {
    (void)ts;
    (void)post;
    (void)type;
    (void)name;
    return 0;
}

void ts_close(struct ts *ts) {
    (void)ts;
}

void ts_send(struct ts *ts, const uint8_t *data, size_t size, int64_t time) {
    (void)ts;
    (void)data;
    (void)size;
    (void)time;
}

#endif
