/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A video item. A thread copies each frame out of the store as soon as it is written, and holds none. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "as_420.h"
#include "live.h"
#include "program.h"
#include "range.h"

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

/* ---- Frames ---- */

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
