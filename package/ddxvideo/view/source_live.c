/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Live sources: a history, and a thread that fills it from a video item or from a stream. */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "history.h"
#include "picture_convert.h"
#include "program.h"
#include "range.h"
#include "source.h"
#include "surface.h"
#include "viewer.h"

/* The common part. */
struct live {
    struct source source;
    struct history history;
    struct surface *surface;
    pthread_t thread;
    atomic_bool stopping, failed;
    pthread_mutex_t lock; /* of text */
    char text[120];
};

static struct history *history_of(struct source *source) {
    return &((struct live *)source)->history;
}

static void live_range(struct source *source, int64_t *oldest, int64_t *newest) {
    history_range(history_of(source), oldest, newest);
}

static struct shot *live_take(struct source *source, int64_t position) {
    return history_take(history_of(source), position);
}

static int64_t live_time(struct source *source, int64_t position) {
    return history_time(history_of(source), position);
}

static void live_work(struct source *source) {
    (void)source;
}

static void live_state(struct source *source, struct source_state *state) {
    struct live *live = (struct live *)source;

    *state = (struct source_state){.failed = live->failed,
                                   .lost = history_lost(&live->history),
                                   .rate = history_rate(&live->history, ddx_time_now())};
    pthread_mutex_lock(&live->lock);
    memcpy(state->text, live->text, sizeof state->text);
    pthread_mutex_unlock(&live->lock);
}

bool live_open(struct live *live, const char *name, const struct source_limits *limits, struct surface *surface) {
    live->source = (struct source){.live = true,
                                   .range = live_range,
                                   .take = live_take,
                                   .time = live_time,
                                   .work = live_work,
                                   .state = live_state};
    snprintf(live->source.name, sizeof live->source.name, "%s", name);
    live->surface = surface;
    pthread_mutex_init(&live->lock, NULL);
    return history_open(&live->history, limits->frames, limits->bytes);
}

/* Fill in the common part. False: no memory. */
bool live_open(struct live *live, const char *name, const struct source_limits *limits, struct surface *surface);
/* The thread has ended. */
static void live_close(struct live *live) {
    history_close(&live->history);
    pthread_mutex_destroy(&live->lock);
}

/* For the thread: add a picture (arrival 0: now); set the text of what the source waits for ("": nothing). */
static void live_add(struct live *live, struct shot *shot) {
    if (!shot->arrival)
        shot->arrival = ddx_time_now();
    history_add(&live->history, shot);
    surface_wake(live->surface);
}

static void live_say(struct live *live, const char *text) {
    pthread_mutex_lock(&live->lock);
    bool same = !strcmp(live->text, text);
    snprintf(live->text, sizeof live->text, "%s", text);
    pthread_mutex_unlock(&live->lock);
    if (!same)
        surface_wake(live->surface);
}

/* ---- A video item: the thread copies each frame out of the store as soon as it is written, and holds none ---- */

#define LOOK 0.2                 /* s, between checks for a stop */
#define AGAIN INT64_C(100000000) /* ns, between searches for a store or an item */
#define CHECK_STORE INT64_C(1000000000)
#define KEEP 4 /* frames: a copy may be this late before a frame is missed */

struct item_source {
    struct live live;
    int port;
    DDX_STORE_ID *id;
    DDX_STORE_ITEM *item;
    struct range *range;
    struct as_420 as;
    int tail;            /* the frame to take next */
    bool begun;          /* a frame has come */
    int64_t source_lost; /* of the previous frame */
    int64_t asked;       /* time of the last check for the store */
    bool said_bad;
};

static void pause_thread(struct item_source *from) {
    const struct timespec moment = {.tv_nsec = AGAIN};

    (void)from;
    clock_nanosleep(CLOCK_MONOTONIC, 0, &moment, NULL);
}

static void say_missing(struct item_source *from, int error) {
    char text[sizeof from->live.text];

    if (error == -ENOENT)
        snprintf(text, sizeof text, "waiting for %s: the store has no such item", from->live.source.name);
    else
        snprintf(text, sizeof text, "waiting: %s", ddx_error_text(error));
    live_say(&from->live, text);
}

static void fail(struct item_source *from, const char *why) {
    say("%s: %s", from->live.source.name, why);
    live_say(&from->live, why);
    from->live.failed = true;
}

static void let_go(struct item_source *from) {
    range_close(from->range);
    ddx_store_done_item(from->item);
    ddx_store_close(from->id);
    from->range = NULL;
    from->item = NULL;
    from->id = NULL;
}

/* False: not a video item. An item that does not exist yet may become one. */
static bool is_video(const char *type) {
    return !*type || !strcmp(type, "DDX_VIDEO");
}

/* Opens a handle on the item, which need not exist yet: then its first frame is received as well. */
static bool find(struct item_source *from) {
    struct ddx_item_info info;

    if (!from->id)
        from->id = ddx_store_open(NULL, from->port, LOOK);
    from->item = from->id ? ddx_store_await_item(from->id, from->live.source.name) : NULL;
    int error = from->item ? ddx_store_item_info(from->item, &info) : -errno;
    if (error) {
        say_missing(from, error);
        let_go(from);
        return false;
    }
    if (!is_video(info.type)) {
        fail(from, "no video item; ddxctl list has the types of all");
        return false;
    }
    from->tail = info.sequence ? DDX_CURRENT : DDX_IN_ORDER;
    ddx_store_keep(from->item, KEEP); /* before the first read, which may fail for lack of memory */
    from->range = range_open(from->id, from->live.source.name);
    if (*info.type)
        live_say(&from->live, "waiting for the first frame");
    else
        say_missing(from, -ENOENT);
    return true;
}

/* Frames that are missing before this one: in the store, and in its source. */
static uint64_t missing_before(struct item_source *from, const struct ddx_frame *frame, int64_t source_lost) {
    int64_t more = source_lost - from->source_lost;
    uint64_t missing = !from->begun ? 0 : frame->missed + (uint64_t)(more > 0 ? more : 0);

    from->source_lost = source_lost;
    from->begun = true;
    return missing;
}

static void take_bad(struct item_source *from, int error) {
    char text[sizeof from->live.text];

    snprintf(text, sizeof text, "a frame that cannot be shown: %s", as_420_error(error));
    if (error == -EPROTOTYPE && !from->begun) {
        fail(from, "no video item; ddxctl list has the types of all");
        return;
    }
    if (!from->said_bad)
        say("%s: %s", from->live.source.name, text);
    from->said_bad = true;
    history_lose(&from->live.history, 1);
    live_say(&from->live, text);
}

static void take(struct item_source *from, const struct ddx_frame *frame) {
    const struct ddxvideo_picture *shown = NULL;
    struct ddxvideo_picture picture;
    int error = ddxvideo_view_any(from->item, frame->data, &picture);

    if (!error)
        error = as_420(&from->as, &picture, &shown);
    struct shot *shot = error ? NULL : history_copy(&from->live.history, shown);
    if (!shot) {
        take_bad(from, error ? error : -ENOMEM);
        return;
    }
    shot->arrival = from->begun ? 0 : frame->time; /* the first frame may be old */
    shot->missing = missing_before(from, frame, picture.stamp.source_lost);
    if (!picture.stamp.time) /* an item with the paper's fields only */
        shot->picture.stamp.time = frame->time;
    live_say(&from->live, "");
    live_add(&from->live, shot);
}

/* Checks that the store still runs: a lack of frames alone does not show its death. */
static bool store_is_there(struct item_source *from) {
    struct ddx_item_info info;
    int64_t now = ddx_time_now();

    if (now - from->asked < CHECK_STORE)
        return true;
    from->asked = now;
    return !ddx_store_item_info(from->item, &info);
}

static void read_frame(struct item_source *from) {
    struct ddx_frame frame;
    int error = ddx_store_acquire(from->item, &frame, LOOK, from->tail);

    if (!error) {
        from->tail = DDX_IN_ORDER;
        take(from, &frame);
        ddx_store_release(from->item);
    } else if (error == -EBUSY && ddx_store_keep(from->item, 1)) {
        say_missing(from, error);
        pause_thread(from);
    } else if (error != -EBUSY && (error != -ETIMEDOUT || !store_is_there(from))) {
        say_missing(from, error == -ETIMEDOUT ? -ECONNREFUSED : error);
        let_go(from);
    }
    if (from->range)
        range_take(from->range, &from->live.history);
}

static void *run(void *argument) {
    struct item_source *from = argument;

    program_thread_signals();
    while (!from->live.stopping && !from->live.failed) {
        if (from->item || find(from))
            read_frame(from);
        else
            pause_thread(from);
    }
    let_go(from);
    as_420_close(&from->as);
    surface_wake(from->live.surface);
    return NULL;
}

static void item_close(struct source *source) {
    struct item_source *from = (struct item_source *)source;

    from->live.stopping = true;
    pthread_join(from->live.thread, NULL);
    live_close(&from->live);
    free(from);
}

struct source *source_item(const char *name, int port, const struct source_limits *limits, struct surface *surface) {
    struct item_source *from = calloc(1, sizeof *from);

    if (!from)
        return NULL;
    from->port = port;
    bool open = live_open(&from->live, name, limits, surface);
    from->live.source.close = item_close;
    if (open && !pthread_create(&from->live.thread, NULL, run, from))
        return &from->live.source;
    live_close(&from->live);
    free(from);
    return NULL;
}

/* ---- A stream: decode's receiver runs in the thread, and each of its pictures goes into the history ---- */

struct stream_source {
    struct live live;
    int64_t source_lost; /* of the previous picture */
    bool begun;
    struct viewer viewer;
};

/* Frames that were lost on the way or in the receiver since the previous picture. */
static uint64_t lost_before(struct stream_source *from, int64_t source_lost) {
    int64_t more = from->begun ? source_lost - from->source_lost : 0;

    from->source_lost = source_lost;
    from->begun = true;
    return more > 0 ? (uint64_t)more : 0;
}

static const char *take_picture(void *to, const AVFrame *frame, AVRational rate, const struct ddxvideo_stamp *stamp) {
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
    shot->missing = lost_before(from, stamp->source_lost);
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

static void *receive(void *argument) {
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
    from->viewer.screen = (struct viewer_screen){.show = take_picture, .tick = tick, .to = from, .each = true};
    bool open = live_open(&from->live, "stream", limits, surface);
    live_say(&from->live, "waiting for the stream");
    from->live.source.close = stream_close;
    if (open && !pthread_create(&from->live.thread, NULL, receive, from))
        return &from->live.source;
    live_close(&from->live);
    free(from);
    *status = EXIT_FAILED;
    return NULL;
}
