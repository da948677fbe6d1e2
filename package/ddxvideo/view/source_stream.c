/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A stream: decode's receiver runs in a thread, and each of its pictures goes into the history. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "live.h"
#include "viewer.h"

struct stream_source {
    struct live live;
    int64_t source_lost; /* of the previous picture */
    bool begun;
    struct viewer viewer;
};

/* Frames that were lost on the way or in the receiver since the previous picture. */
static uint64_t missing_before(struct stream_source *from, int64_t source_lost) {
    int64_t more = from->begun ? source_lost - from->source_lost : 0;

    from->source_lost = source_lost;
    from->begun = true;
    return more > 0 ? (uint64_t)more : 0;
}

static const char *take(void *to, const AVFrame *frame, AVRational rate, const struct ddxvideo_stamp *stamp) {
    struct stream_source *from = to;
    struct ddxvideo_picture picture = output_picture(frame, rate);

    /* MPEG-4 has odd sides as well; pictures here have whole chroma samples. */
    picture.geometry.width &= ~1;
    picture.geometry.height &= ~1;
    if (!picture.geometry.width || !picture.geometry.height)
        return "smaller than 2x2";
    picture.stamp = *stamp;
    struct shot *shot = history_copy(&from->live.history, &picture);
    if (!shot)
        return "out of memory";
    shot->missing = missing_before(from, stamp->source_lost);
    live_say(&from->live, "");
    live_add(&from->live, shot);
    return NULL;
}

/*
 * Shows losses before the next picture comes, which may take long with a bad link. The counters have a picture as lost
 * until it is taken.
 */
static bool tick(void *to) {
    struct stream_source *from = to;
    char text[sizeof from->live.text];
    DDX_STATS stats;

    ddx_stats_get(from->viewer.book, &stats);
    int64_t pending = (int64_t)(stats.in - stats.out) - (from->source_lost - 1);
    if (!from->begun && stats.in)
        live_say(&from->live, "the stream comes; waiting for its first whole picture");
    if (!from->begun || pending <= 0)
        return true;
    history_pend(&from->live.history, (uint64_t)pending);
    snprintf(text, sizeof text, "%" PRId64 " lost since the newest frame", pending);
    live_say(&from->live, text);
    return true;
}

static void *run(void *argument) {
    struct stream_source *from = argument;

    program_thread_signals();
    from->live.failed = viewer_run(&from->viewer) != EXIT_OK;
    surface_wake(from->live.surface);
    return NULL;
}

static void stream_close(struct source *source) {
    struct stream_source *from = (struct stream_source *)source;

    from->viewer.done = true;
    pthread_join(from->live.thread, NULL);
    live_close(&from->live);
    free(from);
}

/* Checks the settings. EXIT_OK, or EXIT_USAGE after a line. */
static int judge(struct viewer *viewer, const struct source_stream *settings) {
    char text[NETWORK_ERROR_MAX + KEY_FILE_ERROR_MAX];

    viewer->inlet = (struct inlet){
        .fd = {-1, -1}, .group = settings->group, .port = settings->port, .interface = settings->interface};
    if (!strcmp(settings->group, "none"))
        viewer->inlet.group = NULL;
    const char *wrong = inlet_parse(&viewer->inlet, text);
    if (!wrong && settings->port % 2) {
        snprintf(text, sizeof text, "-port %ld: an even number is needed", settings->port);
        wrong = text;
    }
    if (wrong) {
        say("%s; see ddxvideoview -help", wrong);
        return EXIT_USAGE;
    }
    if (settings->key && !(viewer->guard.secure = secure_open(settings->key, text))) {
        say("-key %s; see ddxvideoview -help", text);
        return EXIT_USAGE;
    }
    return EXIT_OK;
}

struct source *source_stream(const struct source_stream *settings, bool check, const struct source_limits *limits,
                             struct surface *surface, int *status) {
    struct stream_source *from = calloc(1, sizeof *from);

    *status = from ? judge(&from->viewer, settings) : EXIT_FAILED;
    if (*status || check) {
        free(from);
        return NULL;
    }
    from->viewer.program =
        (struct program){.name = "ddxvideoview", .instance = settings->instance, .port = settings->store};
    from->viewer.patience = 20;
    from->viewer.screen = (struct viewer_screen){.show = take, .tick = tick, .to = from, .each = true};
    bool open = live_open(&from->live, "stream", limits, surface);
    live_say(&from->live, "waiting for the stream");
    from->live.source.close = stream_close;
    if (open && !pthread_create(&from->live.thread, NULL, run, from))
        return &from->live.source;
    live_close(&from->live);
    free(from);
    *status = EXIT_FAILED;
    return NULL;
}
