/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The path of a frame: packets from the network, put together, decoded, shown at once. */
#include "viewer.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "ddx_time.h"

static const char *const reasons[] = VIEWER_REASONS;
static const char *const names[] = {STREAM_RX_NAMES, GUARD_NAMES, VIEWER_REPORT_NAMES, LINK_NAMES};

#define IDLE_NS (100 * MS)                /* longest wait, */
#define WINDOW_NS (10 * MS)               /* with a window */
#define PIXELS_MAX (INT64_C(4096) * 4096) /* of a picture that no store has to hold */
#define BATCH_PACKETS 64                  /* packets of each port: floods do not keep ddxdecode from its other work */
#define LAST_PACKETS 1024                 /* packets, more than the sockets hold */

static void fail(struct viewer *viewer, const char *what, const char *why) {
    say("%s: %s", what, why);
    viewer->status = EXIT_FAILED;
    viewer->done = true;
}

/* ---- Frames ---- */

/* The link's present figures. */
static uint64_t *measure_link(struct viewer *viewer) {
    uint64_t *figures = viewer->packets + STREAM_RX_COUNTS + GUARD_COUNTS + VIEWER_REPORT_COUNTS;

    link_figures(&viewer->link, ddx_time_now(), figures);
    figures[LINK_LOSS] = reporter_loss(&viewer->rx.reporter);
    figures[LINK_RUN] = (uint64_t)(viewer->rx.reporter.run_mean * 10 + 0.5);
    return figures;
}

static void show_counters(struct viewer *viewer) {
    uint64_t *to = viewer->packets;

    memcpy(to, viewer->rx.count, sizeof viewer->rx.count);
    memcpy(to + STREAM_RX_COUNTS, viewer->guard.count, sizeof viewer->guard.count);
    memcpy(to + STREAM_RX_COUNTS + GUARD_COUNTS, viewer->reports, sizeof viewer->reports);
    measure_link(viewer);
    counters_write(&viewer->counters);
}

/* Whether packets came since then. */
static bool has_new_packets(const struct viewer *viewer) {
    return memcmp(viewer->packets, viewer->rx.count, sizeof viewer->rx.count) != 0 ||
           memcmp(viewer->packets + STREAM_RX_COUNTS, viewer->guard.count, sizeof viewer->guard.count) != 0;
}

static void record_frame(struct viewer *viewer, const struct assembly_frame *frame) {
    int64_t time = frame->has_source ? frame->frame.capture : frame->arrival;
    int error = movie_add(&viewer->movie, frame, time, viewer->decoder.context);

    if (error) {
        say("%s: recording stopped: %s", viewer->movie.path, av_err2str(error));
        viewer->status = EXIT_FAILED;
    }
}

static void begin_source(struct viewer *viewer, const struct assembly_frame *frame) {
    int error = decoder_open(&viewer->decoder, frame->type, &viewer->limits);

    if (error)
        fail(viewer, "decoder", av_err2str(error));
    viewer->shown = false;
    viewer->said = 0;
    say("receiving %s, SSRC %08" PRIx32, frame->type == RTP_H264 ? "H.264" : "MPEG-4", viewer->rx.ssrc);
}

/* The frame's picture; NULL if it gives none, or only an unwanted one. */
static const AVFrame *decode_frame(struct viewer *viewer, const struct assembly_frame *frame, bool *damaged) {
    struct decoder *decoder = &viewer->decoder;

    if (frame->damaged && viewer->conceal)
        decoder_want_renewal(decoder);
    else if (frame->damaged)
        decoder_lose(decoder);
    if (frame->incomplete && !viewer->conceal)
        return NULL;
    return decoder_decode(decoder, frame->data, frame->size, damaged);
}

/* Why there is no picture of the frame. */
static enum viewer_loss loss_of(const struct viewer *viewer, const struct assembly_frame *frame) {
    const struct decoder *decoder = &viewer->decoder;

    if (!frame->size)
        return LOST_NETWORK;
    if (!viewer->shown && !decoder->refusal)
        return LOST_JOIN;
    if (frame->incomplete && !viewer->conceal)
        return LOST_NETWORK;
    return decoder->recovering && !decoder->refusal ? LOST_REFRESH : LOST_DECODE;
}

static void handle(struct viewer *viewer, const struct assembly_frame *frame) {
    bool damaged = false;

    if (frame->first)
        begin_source(viewer, frame);
    ddx_stats_in(viewer->book, 1 + frame->missing, 0);
    ddx_stats_lost(viewer->book, LOST_NETWORK, frame->missing);
    const AVFrame *picture = viewer->done ? NULL : decode_frame(viewer, frame, &damaged);
    if (!viewer->done)
        record_frame(viewer, frame);
    if (picture) {
        link_shown(&viewer->link, !viewer->shown, ddx_time_now());
        viewer->shown = true;
        show_picture(viewer, frame, picture, damaged || (frame->damaged && viewer->conceal));
    } else {
        ddx_stats_lost(viewer->book, loss_of(viewer, frame), 1);
        show_refusal(viewer);
    }
    ddx_stats_write(viewer->book);
    show_counters(viewer);
}

static void put_on_screen(struct viewer *viewer) {
    const char *wrong = show_newest(viewer);

    if (wrong)
        fail(viewer, "window", wrong);
}

/* ---- Packets ---- */

static void take_frames(struct viewer *viewer) {
    struct assembly_frame frame;

    while (stream_rx_take(&viewer->rx, ddx_time_now(), &frame))
        handle(viewer, &frame);
}

/* Reports go to the address and port that media packets come from, so that they pass a router with address
 * translation. */
static void put_media(struct viewer *viewer, const uint8_t *data, size_t size, const struct sockaddr_storage *from,
                      int64_t now) {
    struct network_address address;

    viewer->rx.report_header = (network_from(&address, from) ? network_overhead(&address) : 0) +
                               (viewer->guard.secure ? SECURE_REPORT_GROWTH : 0);
    if (stream_rx_put(&viewer->rx, data, size, now))
        viewer->from = *from;
}

/* A datagram that came to one of the ports. False if there is none. */
static bool read_packet(struct viewer *viewer, enum inlet_port port) {
    uint8_t data[RTP_DATAGRAM_MAX + SECURE_ROOM] __attribute__((aligned(4)));
    struct sockaddr_storage from;
    ssize_t came = inlet_read(&viewer->inlet, port, data, RTP_DATAGRAM_MAX, &from);
    size_t size = (size_t)came;
    int64_t now = ddx_time_now();

    if (came < 0)
        return false;
    link_packet(&viewer->link, port == INLET_REPAIR, size, now);
    if (port == INLET_REPAIR && guard_repair(&viewer->guard, data, &size))
        stream_rx_put_repair(&viewer->rx, data, size, now);
    if (port == INLET_MEDIA && guard_media(&viewer->guard, data, &size))
        put_media(viewer, data, size, &from, now);
    take_frames(viewer);
    if (viewer->rx.followed)
        guard_show(&viewer->guard, viewer->rx.ssrc);
    return true;
}

/* The ports by turns, so that a flood on one of them keeps no packet of the other one waiting. */
static void read_packets(struct viewer *viewer, int most) {
    bool media = true, repair = true;

    for (int i = 0; i < most && (media || repair); i++) {
        media = read_packet(viewer, INLET_MEDIA);
        repair = read_packet(viewer, INLET_REPAIR);
    }
}

static void join_group(struct viewer *viewer) {
    int64_t now = ddx_time_now();

    if (viewer->inlet.joined || now < viewer->joining)
        return;
    viewer->joining = now + SECOND;
    int error = inlet_join(&viewer->inlet);
    if (error && !viewer->said_join) {
        say("cannot join %s: %s%s; trying again", viewer->inlet.group, strerror(-error),
            network_advice(error, viewer->inlet.interface));
        viewer->said_join = true;
    }
}

static void wait_for_packets(const struct viewer *viewer) {
    struct pollfd wanted[INLET_PORTS];
    int64_t now = ddx_time_now(), limit = viewer->screen.tick && !viewer->screen.each ? WINDOW_NS : IDLE_NS;
    int64_t gap = stream_rx_deadline(&viewer->rx);
    int64_t report = stream_rx_report_deadline(&viewer->rx);
    int64_t until = gap < report ? gap : report;
    int64_t wait = until <= now ? 0 : until - now < limit ? until - now : limit;
    const struct timespec timeout = {.tv_nsec = (long)wait};

    for (int port = 0; port < INLET_PORTS; port++)
        wanted[port] = (struct pollfd){.fd = viewer->inlet.fd[port], .events = POLLIN};
    ppoll(wanted, INLET_PORTS, &timeout, NULL);
}

static bool send_report(const struct viewer *viewer, uint8_t *data, size_t size) {
    socklen_t length = viewer->from.ss_family == AF_INET ? sizeof(struct sockaddr_in) : sizeof(struct sockaddr_in6);

    if (viewer->guard.secure && secure_protect_report(viewer->guard.secure, data, &size))
        return false;
    return sendto(viewer->inlet.fd[INLET_MEDIA], data, size, MSG_DONTWAIT | MSG_NOSIGNAL,
                  (const struct sockaddr *)&viewer->from, length) >= 0;
}

/* Sends the report that is due. Nothing waits. */
static void report_losses(struct viewer *viewer) {
    uint8_t data[REPORT_MAX + SECURE_ROOM] __attribute__((aligned(4)));
    size_t size = stream_rx_report(&viewer->rx, ddx_time_now(), decoder_wants_renewal(&viewer->decoder), data);

    if (size)
        viewer->reports[send_report(viewer, data, size) ? VIEWER_REPORTS : VIEWER_REPORTS_LOST]++;
}

static void tell_link(struct viewer *viewer) {
    char text[LINK_TEXT_MAX];

    if (link_says(&viewer->link, ddx_time_now(), measure_link(viewer), text))
        say("%s", text);
}

/* Counts packets that give no frame, and reports in a line why they are refused. */
static void tell_refused(struct viewer *viewer) {
    char text[GUARD_TEXT_MAX];
    int64_t now = ddx_time_now();

    if (now - viewer->counted >= IDLE_NS && has_new_packets(viewer)) {
        show_counters(viewer);
        viewer->counted = now;
    }
    if (guard_says(&viewer->guard, now, text))
        say("%s", text);
}

static void view_stream(struct viewer *viewer) {
    while (!program_stopping() && !viewer->done) {
        join_group(viewer);
        wait_for_packets(viewer);
        read_packets(viewer, BATCH_PACKETS);
        take_frames(viewer);
        report_losses(viewer);
        tell_refused(viewer);
        tell_link(viewer);
        put_on_screen(viewer);
        if (viewer->screen.tick && !viewer->screen.tick(viewer->screen.to))
            viewer->done = true;
        program_tick(viewer->book);
    }
    /* At a stop: shows frames that had arrived, and frames that wait for a missing packet. */
    read_packets(viewer, LAST_PACKETS);
    struct assembly_frame frame;
    while (stream_rx_take_last(&viewer->rx, &frame))
        handle(viewer, &frame);
    put_on_screen(viewer);
}

/* ---- Start and end ---- */

/* An item needs memory of four frames: one for a reader, one for the writer, and the same for a change of writer. */
static void find_limits(struct viewer *viewer) {
    struct ddx_item_info *items;
    struct ddx_store_info store;
    unsigned count;

    viewer->limits = (struct decoder_limits){.pixels = PIXELS_MAX, .even = viewer->output.name};
    if (!viewer->output.name || !viewer->id || ddx_store_list(viewer->id, &store, &items, &count))
        return;
    free(items);
    viewer->limits.pixels = (int64_t)(store.budget / 4 / 3 * 2);
    if (viewer->limits.pixels > (int64_t)DDX_VIDEO_SIDE * DDX_VIDEO_SIDE)
        viewer->limits.pixels = (int64_t)DDX_VIDEO_SIDE * DDX_VIDEO_SIDE;
}

/* The store is for our counters, and for the pictures if requested; only then it is required. */
static bool attach_store(struct viewer *viewer) {
    if (viewer->output.name)
        viewer->id = program_connect(&viewer->program);
    else
        viewer->id = ddx_store_open(NULL, (int)viewer->program.port, 0);
    if (!viewer->id)
        return !viewer->output.name;
    if (!program_attach(&viewer->program, viewer->book, viewer->id, NULL)) {
        viewer->status = EXIT_FAILED;
        return false;
    }
    counters_open(&viewer->counters, viewer->id);
    return true;
}

static bool prepare(struct viewer *viewer) {
    int error = inlet_open(&viewer->inlet);

    if (error) {
        say("port %ld: %s", viewer->inlet.port, strerror(-error));
        viewer->status = EXIT_FAILED;
        return false;
    }
    error = inlet_open_repair(&viewer->inlet);
    if (error)
        say("port %ld: %s; going on without repair packets", viewer->inlet.port + NETWORK_REPAIR, strerror(-error));
    const struct stream_rx_settings settings = {.patience = viewer->patience * MS,
                                                .repairs = !viewer->conceal && !error,
                                                .reports = !viewer->silent,
                                                .ssrc = (uint32_t)program_random()};
    stream_rx_init(&viewer->rx, &settings);
    if (!viewer->headless && !viewer->screen.show)
        show_in_window(viewer);
    viewer->newest.picture = av_frame_alloc();
    if (!viewer->newest.picture)
        return false;
    if (!attach_store(viewer))
        return false;
    find_limits(viewer);
    return true;
}

int viewer_run(struct viewer *viewer) {
    viewer->book = ddx_stats_open(viewer->program.instance, reasons);
    if (!viewer->book) {
        say("-instance %s: %s", viewer->program.instance, ddx_error_text(-errno));
        return EXIT_USAGE;
    }
    av_log_set_level(AV_LOG_FATAL); /* the input is not trusted */
    viewer->counters = (struct counters){.instance = viewer->program.instance,
                                         .names = names,
                                         .values = viewer->packets,
                                         .count = sizeof names / sizeof *names};
    if (prepare(viewer))
        view_stream(viewer);
    show_counters(viewer);
    int error = movie_close(&viewer->movie);
    if (error < 0) {
        say("%s: %s", viewer->movie.path, av_err2str(error));
        viewer->status = EXIT_FAILED;
    }
    counters_print(&viewer->counters, stdout);
    program_report(viewer->book);
    counters_close(&viewer->counters);
    ddx_stats_close(viewer->book);
    output_close(&viewer->output);
    ddx_store_close(viewer->id);
    av_frame_free(&viewer->newest.picture);
    show_close_window(viewer);
    decoder_close(&viewer->decoder);
    stream_rx_free(&viewer->rx);
    inlet_close(&viewer->inlet);
    secure_close(viewer->guard.secure);
    return viewer->status;
}
