/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The path of a frame: out of the store, through the encoder, in packets to the network. Nothing is kept. */
#include "sender.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "h264.h"
#include "mpeg4.h"
#include "sdp.h"

enum { LOST_STORE, LOST_ENCODE, LOST_NETWORK };
static const char *const reasons[] = {"store", "encode", "network", NULL};
static const char *const names[] = {"packets", "bytes", "lost_busy", "lost_route", "lost_other",
                                    "ts_packets", "ts_lost"};

#define WAITING INT64_C(1000000000) /* ns until the sender says that it waits for the item */
#define READ_TIMEOUT 0.2 /* s; a signal does not end a wait, so look up from time to time */

static void fail(struct sender *sender, const char *what, const char *why) {
    say("%s: %s", what, why);
    sender->status = EXIT_FAILED;
    sender->done = true;
}

/* ---- Packets ---- */

static size_t next_payload(struct sender *sender, struct h264_packer *h264, uint8_t *to, bool *last) {
    return sender->type == RTP_H264 ? h264_pack_next(h264, to, last) : mpeg4_pack_next(&sender->mpeg4, to, last);
}

/* True if at least one receiver was sent the whole frame. */
static bool send_frame(struct sender *sender, const struct encoded *encoded, const struct ddx_frame *frame,
                       const struct ddxvideo_stamp *stamp) {
    struct rtp_packet packet = {.type = (uint8_t)sender->type,
                                .time = sender->time_offset + rtp_time(stamp->time),
                                .ssrc = sender->ssrc,
                                .has_count = true,
                                .has_source = true, /* the first packet */
                                .frame = {.capture = stamp->time + stamp->wall_offset,
                                          .sequence = (uint32_t)frame->sequence,
                                          .number = (uint32_t)stamp->frame,
                                          .count = sender->count++}};
    struct h264_packer h264;
    uint8_t data[RTP_HEADER_MAX + RTP_ROOM];
    size_t size;
    unsigned missed = 0;

    if (sender->type == RTP_H264)
        h264_pack(&h264, encoded->data, encoded->size);
    else
        mpeg4_pack(&sender->mpeg4, encoded->data, encoded->size);
    while ((size = next_payload(sender, &h264, data + RTP_HEADER_MAX, &packet.marker))) {
        uint8_t header[RTP_HEADER_MAX];

        packet.sequence = sender->sequence++;
        size_t length = rtp_write(header, &packet);
        uint8_t *begin = data + RTP_HEADER_MAX - length; /* right before the payload */
        memcpy(begin, header, length);
        missed |= outlet_send(&sender->outlet, begin, length + size);
        packet.has_source = false;
    }
    return missed != (1u << sender->outlet.receivers) - 1;
}

static void show_counts(struct sender *sender) {
    const struct outlet *outlet = &sender->outlet;
    const uint64_t now[] = {outlet->packets, outlet->bytes, outlet->lost[OUTLET_BUSY], outlet->lost[OUTLET_ROUTE],
                            outlet->lost[OUTLET_OTHER], sender->ts.outlet.packets, sender->ts.lost};

    memcpy(sender->counts, now, sizeof now);
}

static void tell_network(struct sender *sender, bool good) {
    char text[NETWORK_ERROR_MAX];

    if (!good && !sender->failing)
        say("packets to %s do not go out: %s", network_text(&sender->outlet.receiver[0], text),
            strerror(sender->outlet.error));
    sender->failing = !good;
}

/* ---- Frames ---- */

/* An encoder for pictures like this one. */
static bool choose_encoder(struct sender *sender, const struct ddxvideo_geometry *geometry, bool *fresh) {
    const struct ddxvideo_geometry *now = &sender->encoder.geometry;

    *fresh = !encoder_is_open(&sender->encoder) || !ddxvideo_same_layout(now, geometry) ||
             now->rate_num != geometry->rate_num || now->rate_den != geometry->rate_den;
    if (!*fresh)
        return true;
    const struct encoder_settings settings = {
        .type = sender->type, .bitrate = sender->bitrate * 1000, .fast = sender->fast};
    encoder_close(&sender->encoder);
    int error = encoder_open(&sender->encoder, &settings, geometry);
    if (!error) {
        say("sending %s, %dx%d, %ld kbit/s, SSRC %08" PRIx32, sender->name, geometry->width, geometry->height,
            sender->bitrate, sender->ssrc);
        return true;
    }
    fail(sender, "encoder", av_err2str(error));
    return false;
}

/* Where the description belongs, in path[PATH_MAX]: in the file that is named, or in the folder. 0 or -ENAMETOOLONG. */
static int sdp_path(const struct sender *sender, char *path) {
    size_t length = strlen(sender->sdp);
    const char *name = sender->program.instance;
    bool folder = length && sender->sdp[length - 1] == '/';
    int size = snprintf(path, PATH_MAX, "%s%s%s", sender->sdp, folder ? name : "", folder ? ".sdp" : "");

    return size < PATH_MAX ? 0 : -ENAMETOOLONG;
}

static struct sdp describe(const struct sender *sender, const struct encoded *encoded, const char *name) {
    const struct ddxvideo_geometry *geometry = &sender->encoder.geometry;

    return (struct sdp){.name = name,
                        .address = sender->outlet.receiver[0],
                        .ttl = (int)sender->outlet.ttl,
                        .type = sender->type,
                        .frame = encoded->data,
                        .size = encoded->size,
                        .rate = geometry->rate_num ? (double)geometry->rate_num / geometry->rate_den : 0};
}

/* Pictures are sent all the same where the description cannot be written. */
static void save_sdp(struct sender *sender, const struct encoded *encoded) {
    struct sdp sdp = describe(sender, encoded, sender->program.instance);
    char path[PATH_MAX];
    int error = sdp_path(sender, path);

    if (!error)
        error = sdp_save(&sdp, path);
    if (error)
        say("-sdp %s: no description for players: %s", sender->sdp, strerror(-error));
}

/* The name has the machine's, since a player shows the streams of all robots in one list. */
static void announce_sdp(struct sender *sender, const struct encoded *encoded) {
    char host[HOST_NAME_MAX + 1] = "", name[HOST_NAME_MAX + DDX_NAME_MAX + 20], text[SDP_MAX];

    gethostname(host, sizeof host - 1);
    snprintf(name, sizeof name, "%s %s", host, sender->program.instance);
    struct sdp sdp = describe(sender, encoded, name);
    if (sdp_write(&sdp, text))
        announce_describe(&sender->announce, 0, sender->ssrc, text);
    if (!sender->ts.muxer)
        return;
    snprintf(name + strlen(name), sizeof name - strlen(name), " MPEG-TS");
    sdp.type = RTP_TS;
    sdp.address = sender->ts.outlet.receiver[0];
    if (sdp_write(&sdp, text))
        announce_describe(&sender->announce, 1, sender->ts.ssrc, text);
}

/* The stream goes on without it. */
static void begin_ts(struct sender *sender) {
    int error = ts_open(&sender->ts, &sender->outlet, sender->type, sender->program.instance);

    if (error) {
        say("-ts %ld: %s; the stream goes on without it", sender->ts.port, av_err2str(error));
        ts_close(&sender->ts);
    }
}

/* What is there describes the stream of a forerunner, which may have had other settings. */
static void remove_sdp(const struct sender *sender) {
    char path[PATH_MAX];

    if (sender->sdp && !sdp_path(sender, path))
        unlink(path);
}

/*
 * After the first read, which may have given a frame: what was written since it began is ours to send, and all of an
 * item that was not there when the sender came. What no sender sent since a forerunner died is counted.
 */
static void follow(struct sender *sender, const struct ddx_frame *frame) {
    uint64_t seen = ddx_store_seen(sender->video);
    uint64_t from = frame ? seen - frame->missed - 1 : seen;
    uint64_t before = sender->awaited ? from : 0; /* written between the wait and the first read */

    ddx_stats_follow(sender->book, from - before);
    sender->follows = true;
    if (before) {
        ddx_stats_in(sender->book, before, from);
        ddx_stats_lost(sender->book, LOST_STORE, before);
    }
}

/* Say once that there is no such item, when that lasts. */
static void tell_waiting(struct sender *sender) {
    if (sender->said_waiting || encoder_is_open(&sender->encoder) || ddx_time_now() - sender->begin < WAITING)
        return;
    sender->said_waiting = true;
    program_say_awaited(sender->video, sender->name);
}

static void handle(struct sender *sender, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;
    struct encoded encoded;
    uint64_t missed = frame->missed;
    bool fresh;

    ddx_stats_in(sender->book, missed + 1, frame->sequence);
    ddx_stats_lost(sender->book, LOST_STORE, missed);
    int error = ddxvideo_view(sender->video, frame->data, &view);
    if (error) {
        ddx_stats_lost(sender->book, LOST_STORE, 1);
        if (error == -EPROTOTYPE)
            fail(sender, sender->name, ddx_error_text(error));
        return;
    }
    if (!choose_encoder(sender, &view.geometry, &fresh)) {
        ddx_stats_lost(sender->book, LOST_ENCODE, 1);
        return;
    }
    error = encoder_encode(&sender->encoder, &view, 0, &encoded);
    if (error) {
        say("frame %d is lost in the encoder: %s", view.stamp.frame, av_err2str(error));
        ddx_stats_lost(sender->book, LOST_ENCODE, 1);
        return;
    }
    bool good = send_frame(sender, &encoded, frame, &view.stamp);
    if (good)
        ddx_stats_out(sender->book, 1, ddx_time_now() - frame->time);
    else
        ddx_stats_lost(sender->book, LOST_NETWORK, 1);
    tell_network(sender, good);
    if (fresh && sender->ts.port && !sender->ts.muxer)
        begin_ts(sender);
    ts_send(&sender->ts, encoded.data, encoded.size, view.stamp.time);
    if (fresh && sender->sdp)
        save_sdp(sender, &encoded);
    if (fresh)
        announce_sdp(sender, &encoded);
}

static void take_frame(struct sender *sender, double timeout) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(sender->video, &frame, timeout, DDX_NEXT);

    if (!sender->follows && (!error || error == -ETIMEDOUT))
        follow(sender, error ? NULL : &frame);
    if (!error) {
        handle(sender, &frame);
        ddx_store_release(sender->video);
        show_counts(sender);
        counters_write(&sender->counters);
        ddx_stats_write(sender->book);
    } else if (error != -ETIMEDOUT) {
        fail(sender, sender->name, ddx_error_text(error));
    }
}

static void send_all(struct sender *sender) {
    while (!program_stopping() && !sender->done) {
        take_frame(sender, sender->follows ? READ_TIMEOUT : 0);
        tell_waiting(sender);
        announce_tick(&sender->announce, &sender->outlet, ddx_time_now());
        program_tick(sender->book);
    }
    /* What was published before we were told to stop: the newest is sent, and those before it are counted. */
    if (!sender->done)
        take_frame(sender, 0);
    announce_end(&sender->announce, &sender->outlet);
}

/* ---- Start and end ---- */

int sender_run(struct sender *sender) {
    char text[NETWORK_ERROR_MAX];

    sender->book = ddx_stats_open(sender->program.instance, reasons);
    if (!sender->book) {
        say("-instance %s: %s", sender->program.instance, ddx_error_text(-errno));
        return EXIT_USAGE;
    }
    const char *wrong = outlet_open(&sender->outlet, text);
    if (wrong)
        say("%s", wrong);
    av_log_set_level(AV_LOG_FATAL); /* MPEG-4's encoder reports each frame that is larger than wanted as an error */
    sender->counters = (struct counters){.instance = sender->program.instance,
                                         .names = names,
                                         .values = sender->counts,
                                         .count = sizeof names / sizeof *names};
    DDX_STORE_ID *id = wrong ? NULL : program_connect(&sender->program);
    sender->ssrc = (uint32_t)program_random();
    sender->sequence = (uint16_t)program_random();
    sender->time_offset = (uint32_t)program_random();
    sender->ts.ssrc = (uint32_t)program_random();
    sender->ts.sequence = (uint16_t)program_random();
    if (wrong || (id && !program_attach(&sender->program, sender->book, id, sender->name)))
        sender->status = EXIT_FAILED;
    else if (id) {
        remove_sdp(sender);
        sender->begin = ddx_time_now();
        sender->video = program_await(id, sender->name, sender->book);
        sender->status = sender->video || errno == EINTR ? EXIT_OK : EXIT_FAILED;
        sender->awaited = sender->video && !*ddx_store_item_type(sender->video);
        counters_open(&sender->counters, id);
        if (sender->video)
            send_all(sender);
    }
    encoder_close(&sender->encoder);
    ts_close(&sender->ts);
    counters_print(&sender->counters, stdout);
    program_report(sender->book);
    counters_close(&sender->counters);
    if (sender->status)
        ddx_stats_fail(sender->book);
    ddx_stats_close(sender->book);
    ddx_store_done_item(sender->video);
    ddx_store_close(id);
    outlet_close(&sender->outlet);
    return sender->status;
}
