/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The path of a frame: packets from the network, put together, decoded, shown at once. */
#include "viewer.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

enum { LOST_NETWORK, LOST_JOIN, LOST_DECODE, LOST_STORE };
static const char *const reasons[] = {"network", "join", "decode", "store", NULL};
static const char *const names[] = {INTAKE_NAMES};

#define MS INT64_C(1000000)
#define NS INT64_C(1000000000)
#define IDLE (100 * MS)  /* look up at least so often, */
#define WINDOW (10 * MS) /* with a window */
#define PIXELS_MAX (INT64_C(4096) * 4096) /* of a picture that no store has to hold */
#define SAID_STORE 31                     /* a bit beside those of enum decoder_refusal */
#define BATCH 1024       /* packets, more than the socket holds: who floods us does not keep us from the rest */

static void fail(struct viewer *viewer, const char *what, const char *why) {
    say("%s: %s", what, why);
    viewer->status = EXIT_FAILED;
    viewer->done = true;
}

/* ---- Frames ---- */

/* When the frame was captured, on this machine's monotonic clock; the wall clocks of both have to agree. */
static struct ddxvideo_stamp stamp_of(const struct viewer *viewer, const struct assembly_frame *frame) {
    int64_t wall_offset = ddxvideo_wall_offset();
    struct ddxvideo_stamp stamp = {.time = frame->arrival, .wall_offset = wall_offset};

    if (frame->has_source) {
        stamp.frame = (int)(frame->frame.number & INT32_MAX);
        stamp.time = frame->frame.capture - wall_offset;
        stamp.source_sequence = frame->frame.sequence;
    }
    DDX_STATS stats;
    ddx_stats_get(viewer->book, &stats);
    stamp.source_lost = (int64_t)(stats.in - stats.out);
    return stamp;
}

/* Once a source: the network must not fill the log. */
static bool says_first(struct viewer *viewer, unsigned bit) {
    bool first = !(viewer->said & 1u << bit);

    viewer->said |= 1u << bit;
    return first;
}

static void say_refusal(struct viewer *viewer) {
    const struct decoder *decoder = &viewer->decoder;
    char limit[80] = "";

    if (!decoder->refusal || !says_first(viewer, decoder->refusal))
        return;
    snprintf(limit, sizeof limit, "more than %" PRId64 " pixels%s", viewer->limits.pixels,
             viewer->output.name ? ", what the store can hold" : "");
    const char *why = decoder->refusal == DECODER_SIZE     ? limit
                      : decoder->refusal == DECODER_FRAMES ? "it wants too many reference frames of this size"
                      : decoder->refusal == DECODER_ODD    ? "the store needs an even width and height"
                                                           : "it is not 8-bit 4:2:0";
    if (decoder->refusal == DECODER_FORMAT)
        say("a stream that cannot be shown: %s; its frames count as lost.decode", why);
    else
        say("a stream of %dx%d that cannot be shown: %s; its frames count as lost.decode", decoder->width,
            decoder->height, why);
}

static void say_store(struct viewer *viewer, int error) {
    if (output_is_refused(error)) {
        if (says_first(viewer, SAID_STORE))
            say("%s: the store refuses the pictures: %s; trying again", viewer->output.name, ddx_error_text(error));
        return;
    }
    if (error && !viewer->said_store) /* it hangs, or is started anew: it will be back */
        say("%s: the store does not answer; trying again", viewer->output.name);
    viewer->said_store = error != 0;
}

static void show(struct viewer *viewer, const struct assembly_frame *frame, const AVFrame *picture, bool damaged) {
    struct ddxvideo_stamp stamp = stamp_of(viewer, frame);
    int error = output_write(&viewer->output, viewer->id, picture, viewer->decoder.context->framerate, &stamp);

    say_store(viewer, error);
    const char *wrong = viewer->display ? display_show(viewer->display, picture) : NULL;
    if (wrong)
        fail(viewer, "window", wrong);
    int64_t latency = ddx_time_now() - stamp.time;
    if (error && !viewer->display) {
        ddx_stats_lost(viewer->book, output_is_refused(error) ? LOST_DECODE : LOST_STORE, 1);
        return;
    }
    ddx_stats_out(viewer->book, 1, latency);
    if (viewer->print) {
        printf("frame %d sequence %" PRId64 " latency_us %" PRId64 "%s\n", stamp.frame, stamp.source_sequence,
               latency / 1000, damaged ? " damaged" : "");
        fflush(stdout);
    }
}

static void record(struct viewer *viewer, const struct assembly_frame *frame) {
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
    say("receiving %s, SSRC %08" PRIx32, frame->type == RTP_H264 ? "H.264" : "MPEG-4", viewer->intake.ssrc);
}

static void handle(struct viewer *viewer, const struct assembly_frame *frame) {
    bool damaged = false;

    if (frame->first)
        begin_source(viewer, frame);
    ddx_stats_in(viewer->book, 1 + frame->missing, 0);
    ddx_stats_lost(viewer->book, LOST_NETWORK, frame->missing);
    const AVFrame *picture = viewer->done ? NULL : decoder_decode(&viewer->decoder, frame->data, frame->size, &damaged);
    if (!viewer->done)
        record(viewer, frame);
    if (picture) {
        viewer->shown = true;
        show(viewer, frame, picture, damaged || frame->damaged);
    } else {
        bool begun = viewer->shown || viewer->decoder.refusal;

        ddx_stats_lost(viewer->book, !frame->size ? LOST_NETWORK : begun ? LOST_DECODE : LOST_JOIN, 1);
        say_refusal(viewer);
    }
    ddx_stats_write(viewer->book);
    counters_write(&viewer->counters);
}

/* ---- Packets ---- */

static void take_frames(struct viewer *viewer) {
    struct assembly_frame frame;

    while (intake_take(&viewer->intake, ddx_time_now(), &frame))
        handle(viewer, &frame);
}

static void read_packets(struct viewer *viewer) {
    uint8_t data[RTP_DATAGRAM_MAX];
    ssize_t size;

    for (int i = 0; i < BATCH && (size = inlet_read(&viewer->inlet, data, sizeof data)) >= 0; i++) {
        intake_put(&viewer->intake, data, (size_t)size, ddx_time_now());
        take_frames(viewer);
    }
}

static void join(struct viewer *viewer) {
    int64_t now = ddx_time_now();

    if (viewer->inlet.joined || now < viewer->joining)
        return;
    viewer->joining = now + NS;
    int error = inlet_join(&viewer->inlet);
    if (error && !viewer->said_join) {
        say("cannot join %s: %s; trying again", viewer->inlet.group, strerror(-error));
        viewer->said_join = true;
    }
}

static void wait_for_packets(const struct viewer *viewer) {
    struct pollfd wanted = {.fd = viewer->inlet.fd, .events = POLLIN};
    int64_t now = ddx_time_now(), limit = viewer->display ? WINDOW : IDLE;
    int64_t until = intake_deadline(&viewer->intake);
    int64_t wait = until <= now ? 0 : until - now < limit ? until - now : limit;
    const struct timespec timeout = {.tv_nsec = (long)wait};

    ppoll(&wanted, 1, &timeout, NULL);
}

static void view(struct viewer *viewer) {
    while (!program_stopping() && !viewer->done) {
        join(viewer);
        wait_for_packets(viewer);
        read_packets(viewer);
        take_frames(viewer);
        if (viewer->display && !display_tick(viewer->display))
            viewer->done = true;
        program_tick(viewer->book);
    }
    /* What was there before we were told to stop; also what waits for a packet that comes no more. */
    read_packets(viewer);
    struct assembly_frame frame;
    while (intake_take_last(&viewer->intake, &frame))
        handle(viewer, &frame);
}

/* ---- Start and end ---- */

/* An item needs four frames of memory: one that is read, one that is written, and as much for a change of writer. */
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

/* A store shows our counters, and takes the pictures if that is wanted; only then it has to be there. */
static bool attach(struct viewer *viewer) {
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
    const char *wrong;
    int error = inlet_open(&viewer->inlet);

    if (error) {
        say("port %ld: %s", viewer->inlet.port, strerror(-error));
        viewer->status = EXIT_FAILED;
        return false;
    }
    if (!viewer->headless && !(viewer->display = display_open(viewer->program.instance, &wrong)))
        say("no window: %s; going on without one, as with -headless", wrong);
    if (!attach(viewer))
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
    av_log_set_level(AV_LOG_FATAL); /* what arrives may be anything */
    intake_init(&viewer->intake, viewer->patience * MS, true);
    viewer->counters = (struct counters){
        .instance = viewer->program.instance, .names = names, .values = viewer->intake.count, .count = INTAKE_COUNTS};
    if (prepare(viewer))
        view(viewer);
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
    display_close(viewer->display);
    decoder_close(&viewer->decoder);
    intake_free(&viewer->intake);
    inlet_close(&viewer->inlet);
    return viewer->status;
}
