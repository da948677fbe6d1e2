/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The path of a frame: from the store through the encoder, as packets to the network. No frame is delayed. */
#include "sender.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "ddx_time.h"
#include "sdp.h"

enum { LOST_STORE, LOST_ENCODE, LOST_NETWORK, LOST_RATE };
static const char *const reasons[] = {"store", "encode", "network", "rate", NULL};
static const char *const names[SENDER_COUNTS] = {
    "packets",     "bytes",     "lost_busy",      "lost_route",  "lost_other",   "media",     "repairs",
    "wire_bytes",  "reports",   "reports_unused", "frame_bytes", "ts_packets",   "ts_lost",   "others",
    "others_lost", "wire_kbit", "repair_percent", "video_kbit",  "loss_percent", "run_tenths"};

#define WAITING_NS INT64_C(1000000000)      /* ns until the sender reports that it waits for the item */
#define FRAME_INTERVAL_NS INT64_C(40000000) /* ns, where the rate is not known */
#define READ_SECONDS 0.2                    /* s; a signal does not end a wait, so waits are short */

static void fail(struct sender *sender, const char *what, const char *why) {
    say("%s: %s", what, why);
    sender->status = EXIT_FAILED;
    sender->done = true;
}

/* ---- The description of the stream (SDP): in a file, and announced (SAP) ---- */

static bool is_folder(const char *sdp) {
    size_t length = strlen(sdp);

    return length && sdp[length - 1] == '/';
}

/* The description's path in path[PATH_MAX]: the named file, or one in the folder. 0 or -ENAMETOOLONG. */
static int sdp_path(const struct sender *sender, char *path) {
    const char *name = sender->program.instance;
    bool folder = is_folder(sender->sdp);
    int size = snprintf(path, PATH_MAX, "%s%s%s", sender->sdp, folder ? name : "", folder ? ".sdp" : "");

    return size < PATH_MAX ? 0 : -ENAMETOOLONG;
}

static struct sdp description(const struct sender *sender, const struct encoded *encoded, const char *name) {
    const struct ddxvideo_geometry *geometry = &sender->encoder.geometry;

    return (struct sdp){.name = name,
                        .address = sender->outlet.receiver[0],
                        .ttl = (int)sender->outlet.ttl,
                        .type = sender->type,
                        .frame = encoded->data,
                        .size = encoded->size,
                        .rate = geometry->rate_num ? (double)geometry->rate_num / geometry->rate_den : 0};
}

/* Pictures are sent even if the description cannot be written. */
static void save_sdp(struct sender *sender, const struct encoded *encoded) {
    struct sdp sdp = description(sender, encoded, sender->program.instance);
    char path[PATH_MAX], crypto[SECURE_SDP_MAX];
    int error = sdp_path(sender, path);

    if (sender->secure) { /* in the file only, never in an announcement */
        secure_sdp(sender->secure, crypto);
        sdp.crypto = crypto;
    }
    if (!error)
        error = sdp_save(&sdp, path);
    explicit_bzero(crypto, sizeof crypto);
    if (error)
        say("-sdp %s: no description for players: %s", sender->sdp, strerror(-error));
}

/* The name begins with the machine's name, since players list the streams of all robots together. */
static void announce_sdp(struct sender *sender, const struct encoded *encoded) {
    char host[HOST_NAME_MAX + 1] = "", name[HOST_NAME_MAX + DDX_NAME_MAX + 20], text[SDP_MAX];

    gethostname(host, sizeof host - 1);
    snprintf(name, sizeof name, "%s %s", host, sender->program.instance);
    struct sdp sdp = description(sender, encoded, name);
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

/* Write and announce the description. `encoded`: a frame with parameter sets. Failures are reported, no more. */
static void describe(struct sender *sender, const struct encoded *encoded) {
    if (sender->sdp)
        save_sdp(sender, encoded);
    announce_sdp(sender, encoded);
}

/* An earlier sender of this instance may have left the file, with other settings. */
static void describe_nothing(const struct sender *sender) {
    char path[PATH_MAX];

    if (sender->sdp && !sdp_path(sender, path))
        unlink(path);
}

/*
 * The stream has stopped: a folder keeps no description of it, since a reader would take it for that of the next
 * stream, until that sender is connected and removes it. A file that the user named remains.
 */
static void describe_end(const struct sender *sender) {
    if (sender->sdp && is_folder(sender->sdp))
        describe_nothing(sender);
}

/* ---- Packets ---- */

/* Hand the frame to the network thread. False if it does not fit. */
static bool send_frame(struct sender *sender, const struct encoded *encoded, const struct ddx_frame *frame,
                       const struct ddxvideo_stamp *stamp) {
    const struct rtp_packet packet = {.type = (uint8_t)sender->type,
                                      .time = sender->time_offset + rtp_time(stamp->time),
                                      .frame = {.capture = stamp->time + stamp->wall_offset,
                                                .sequence = (uint32_t)frame->sequence,
                                                .number = (uint32_t)stamp->frame,
                                                .encrypted = sender->secure,
                                                .window = sender->repairs ? REPAIR_FRAMES : 0,
                                                .count = sender->count}};

    sender->count++; /* even if it does not fit: the receiver must notice the missing frame */
    return post_frame(&sender->post, frame->time, &packet, encoded->data, encoded->size);
}

/* Once a second. */
static void measure_rate(struct sender_rate *rate, const uint64_t tx[STREAM_TX_COUNTS], int64_t now) {
    uint64_t bytes = tx[STREAM_TX_BYTES], media = tx[STREAM_TX_SENT], repairs = tx[STREAM_TX_REPAIRS];
    int64_t passed = now - rate->begin;

    if (passed < SECOND)
        return;
    *rate = (struct sender_rate){
        .kbit = (bytes - rate->bytes) * 8 * (SECOND / 1000) / (uint64_t)passed,
        .video = (tx[STREAM_TX_MEDIA_BYTES] - rate->media_bytes) * 8 * (SECOND / 1000) / (uint64_t)passed,
        .percent = media > rate->media ? (repairs - rate->repairs) * 100 / (media - rate->media) : 0,
        .begin = now,
        .bytes = bytes,
        .media_bytes = tx[STREAM_TX_MEDIA_BYTES],
        .media = media,
        .repairs = repairs};
}

static void show_counts(struct sender *sender) {
    uint64_t tx[STREAM_TX_COUNTS], feedback[FEEDBACK_COUNTS];
    double loss, run;

    post_losses(&sender->post, &loss, &run);
    post_counts(&sender->post, tx, feedback, &sender->sent);
    const struct outlet *outlet = &sender->sent;
    measure_rate(&sender->rate, tx, ddx_time_now());
    const uint64_t now[SENDER_COUNTS] = {outlet->packets,
                                         outlet->bytes,
                                         outlet->lost[OUTLET_BUSY],
                                         outlet->lost[OUTLET_ROUTE],
                                         outlet->lost[OUTLET_OTHER],
                                         tx[STREAM_TX_SENT],
                                         tx[STREAM_TX_REPAIRS],
                                         tx[STREAM_TX_BYTES],
                                         feedback[FEEDBACK_RECEIVED],
                                         feedback[FEEDBACK_RECEIVED] - feedback[FEEDBACK_USED],
                                         sender->wanted,
                                         sender->ts.outlet.packets,
                                         sender->ts.lost,
                                         tx[STREAM_TX_OTHERS],
                                         tx[STREAM_TX_OTHERS_LOST],
                                         sender->rate.kbit,
                                         sender->rate.percent,
                                         sender->rate.video,
                                         (uint64_t)(loss * 100 + 0.5),
                                         (uint64_t)(run * 10 + 0.5)};

    memcpy(sender->counts, now, sizeof now);
}

static void tell_network(struct sender *sender, bool good) {
    char text[NETWORK_ERROR_MAX];

    if (!good && !sender->failing)
        say("packets to %s are not sent: %s%s", network_text(&sender->sent.receiver[0], text),
            strerror(sender->sent.error),
            sender->outlet.group ? network_advice(-sender->sent.error, sender->outlet.interface) : "");
    sender->failing = !good;
}

/* Counts the outcomes of frames that were handed over. */
static void count_outcomes(struct sender *sender) {
    struct post_outcome outcome = post_collect(&sender->post);

    show_counts(sender);
    if (outcome.sent)
        ddx_stats_out(sender->book, outcome.sent, outcome.latency);
    ddx_stats_lost(sender->book, LOST_NETWORK, outcome.lost);
    if (outcome.sent || outcome.lost)
        tell_network(sender, outcome.sent > 0);
    counters_write(&sender->counters);
    ddx_stats_write(sender->book);
}

/* ---- Frames ---- */

/* ns from frame to frame */
static int64_t interval_of(const struct ddxvideo_geometry *geometry) {
    return geometry->rate_num > 0 && geometry->rate_den > 0 ? SECOND * geometry->rate_den / geometry->rate_num
                                                            : FRAME_INTERVAL_NS;
}

static struct encoder_settings encoder_settings(const struct sender *sender) {
    /* MPEG-4's encoder makes frames for this rate, and follows a lower one only partly. */
    long most = (long)((double)sender->wire * STREAM_TX_VIDEO);
    long bitrate = !sender->bitrate ? most : sender->bitrate < sender->wire ? sender->bitrate : sender->wire;

    return (struct encoder_settings){.type = sender->type, .bitrate = bitrate * 1000, .fast = sender->fast};
}

/* An encoder for pictures like this one. */
static bool choose_encoder(struct sender *sender, const struct ddxvideo_geometry *geometry) {
    const struct ddxvideo_geometry *now = &sender->encoder.geometry;

    if (encoder_is_open(&sender->encoder) && ddxvideo_same_layout(now, geometry) &&
        now->rate_num == geometry->rate_num && now->rate_den == geometry->rate_den)
        return true;
    sender->described = false;
    const struct encoder_settings settings = encoder_settings(sender);
    encoder_close(&sender->encoder);
    int error = encoder_open(&sender->encoder, &settings, geometry);
    if (!error) {
        post_set_interval(&sender->post, interval_of(geometry));
        say("sending %s, %dx%d, %ld kbit/s, SSRC %08" PRIx32, sender->name, geometry->width, geometry->height,
            sender->wire, sender->ssrc);
        return true;
    }
    fail(sender, "encoder", av_err2str(error));
    return false;
}

/* The stream continues without it. */
static void begin_ts(struct sender *sender) {
    int error = ts_open(&sender->ts, &sender->post, sender->type, sender->program.instance);

    if (error) {
        say("-ts %ld: %s; the stream continues without it", sender->ts.port, av_err2str(error));
        ts_close(&sender->ts);
    }
}

/*
 * Called after the first read, which may have given a frame. Frames count from the start of that read on, or all of
 * them if the item did not exist when the sender started. Frames since the death of a former sender count as well.
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

/* Reports once, after a while, that the item does not exist. */
static void tell_waiting(struct sender *sender) {
    if (sender->said_waiting || encoder_is_open(&sender->encoder) || ddx_time_now() - sender->begin < WAITING_NS)
        return;
    sender->said_waiting = true;
    program_say_awaited(sender->video, sender->name);
}

/* A new start would fail again: the exit status is that of bad input. */
static void refuse_size(struct sender *sender, const struct ddxvideo_geometry *geometry) {
    say("%s: pictures of %dx%d cannot be sent; the smallest size is 2x2", sender->name, geometry->width,
        geometry->height);
    sender->status = EXIT_USAGE;
    sender->done = true;
}

static void handle_frame(struct sender *sender, const struct ddx_frame *frame) {
    struct ddxvideo_picture view;
    struct encoded encoded;
    uint64_t missed = frame->missed;

    ddx_stats_in(sender->book, missed + 1, frame->sequence);
    ddx_stats_lost(sender->book, LOST_STORE, missed);
    int error = ddxvideo_view_any(sender->video, frame->data, &view);
    if (error) {
        ddx_stats_lost(sender->book, LOST_STORE, 1);
        if (error == -EPROTOTYPE)
            fail(sender, sender->name, ddx_error_text(error));
        return;
    }
    const struct ddxvideo_geometry geometry = as_420_geometry(&view.geometry);
    if (!geometry.width || !geometry.height)
        refuse_size(sender, &view.geometry);
    if (sender->done || !choose_encoder(sender, &geometry)) {
        ddx_stats_lost(sender->book, LOST_ENCODE, 1);
        return;
    }
    sender->wanted = post_allowance(&sender->post);
    if (!sender->wanted) { /* the frames before it are still on their way */
        ddx_stats_lost(sender->book, LOST_RATE, 1);
        return;
    }
    size_t whole;
    if (post_wants_refresh(&sender->post, &whole)) {
        encoder_refresh(&sender->encoder, whole > 0);
        sender->wanted = whole > sender->wanted ? whole : sender->wanted;
    }
    const struct ddxvideo_picture *picture;
    error = as_420(&sender->as_420, &view, &picture);
    if (!error)
        error = encoder_encode(&sender->encoder, picture, sender->wanted, &encoded);
    if (error) {
        say("frame %d is lost in the encoder: %s", view.stamp.frame, av_err2str(error));
        ddx_stats_lost(sender->book, LOST_ENCODE, 1);
        return;
    }
    if (!send_frame(sender, &encoded, frame, &view.stamp))
        ddx_stats_lost(sender->book, LOST_NETWORK, 1);
    if (sender->ts.port && !sender->ts.muxer && !sender->described)
        begin_ts(sender);
    ts_send(&sender->ts, encoded.data, encoded.size, view.stamp.time);
    if (!sender->described)
        describe(sender, &encoded);
    sender->described = true;
}

static void take_frame(struct sender *sender, double timeout) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(sender->video, &frame, timeout, DDX_NEXT);

    if (!sender->follows && (!error || error == -ETIMEDOUT))
        follow(sender, error ? NULL : &frame);
    if (!error) {
        handle_frame(sender, &frame);
        ddx_store_release(sender->video);
    } else if (error != -ETIMEDOUT) {
        fail(sender, sender->name, ddx_error_text(error));
    }
    count_outcomes(sender);
}

static void send_all(struct sender *sender) {
    while (!program_stopping() && !sender->done) {
        take_frame(sender, sender->follows ? READ_SECONDS : 0);
        tell_waiting(sender);
        announce_tick(&sender->announce, &sender->post, ddx_time_now());
        program_tick(sender->book);
    }
    /* Frames published before the stop: the newest is sent, the others are counted. */
    if (!sender->done)
        take_frame(sender, 0);
    announce_end(&sender->announce, &sender->post);
}

/* ---- Start and end ---- */

static int start_post(struct sender *sender) {
    struct stream_tx_settings settings = {.wire = sender->wire * 1000,
                                          .video = sender->bitrate * 1000,
                                          .interval = FRAME_INTERVAL_NS,
                                          .repair = sender->repairs,
                                          .renewal = sender->type == RTP_H264 ? ENCODER_RENEWAL_SECONDS * SECOND : 0,
                                          .ratio = sender->ratio,
                                          .others = sender->ts.port ? TS_PART : 0,
                                          .media_ssrc = sender->ssrc,
                                          .repair_ssrc = (uint32_t)program_random(),
                                          .media_sequence = (uint16_t)program_random(),
                                          .repair_sequence = (uint16_t)program_random()};

    for (unsigned i = 0; i < sender->outlet.receivers; i++) {
        size_t header = network_overhead(&sender->outlet.receiver[i]);

        settings.header = header > settings.header ? header : settings.header;
    }
    settings.header += sender->secure ? SECURE_GROWTH_MEAN : 0;
    int error = post_start(&sender->post, &sender->outlet, sender->secure, &settings);
    if (error)
        fail(sender, "thread", strerror(-error));
    return error;
}

int sender_run(struct sender *sender) {
    char text[NETWORK_ERROR_MAX];

    sender->book = program_book(&sender->program, reasons);
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
    sender->time_offset = (uint32_t)program_random();
    sender->ts.ssrc = (uint32_t)program_random();
    sender->ts.sequence = (uint16_t)program_random();
    if (wrong || (id && !program_attach(&sender->program, sender->book, id, sender->name)))
        sender->status = EXIT_FAILED;
    else if (id) {
        describe_nothing(sender);
        const struct encoder_settings settings = encoder_settings(sender);
        encoder_warm(&settings); /* before the item is opened, since its frames count from then on */
        sender->begin = ddx_time_now();
        sender->video = program_await(id, sender->name, sender->book);
        sender->status = sender->video || errno == EINTR ? EXIT_OK : EXIT_FAILED;
        sender->awaited = sender->video && !*ddx_store_item_type(sender->video);
        counters_open(&sender->counters, id);
        if (sender->video && !start_post(sender)) {
            send_all(sender);
            post_stop(&sender->post);
            count_outcomes(sender);
        }
        describe_end(sender);
    }
    encoder_close(&sender->encoder);
    as_420_close(&sender->as_420);
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
    secure_close(sender->secure);
    return sender->status;
}
