/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "player.h"

#include <ddx.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ddx_time.h"
#include "text.h"
#include "video_layout.h"

/* The text below the picture: the frame, and what is missing. */
struct caption_facts {
    const char *name; /* of the item */
    bool shown;       /* a picture is on display: */
    int frame;        /* its number */
    double rate;      /* frames a second, 0 if unknown */
    int64_t age;      /* of the picture, ns since its capture */
    struct watch_view writer;
    const char *missing; /* missing now; NULL: nothing */
    int64_t since;       /* ns since it is missing */
    bool stale;          /* the picture is old */
};

/* ---- Still ---- */

static void still_close(struct still *still) {
    free(still->bytes);
    *still = (struct still){.size = 0};
}

/* 0, or -ENOMEM: then there is no picture. */
static int still_take(struct still *still, const struct ddxvideo_picture *picture) {
    size_t size = video_layout_bytes(&picture->geometry);

    if (size != still->size) {
        still_close(still);
        still->bytes = malloc(size);
        if (!still->bytes)
            return -ENOMEM;
        still->size = size;
    }
    video_layout_copy(&still->picture, picture, still->bytes);
    return 0;
}

/* ---- Monitor ---- */

#define AGAIN_NS INT64_C(500000000)

static void complain(struct monitor *monitor, const char *reason) {
    if (strcmp(monitor->said, reason) != 0)
        say("%s; trying again", reason);
    snprintf(monitor->said, sizeof monitor->said, "%s", reason);
}

/* Whether a screen is open; tries to open one, at most twice a second. */
static bool has_screen(struct monitor *monitor) {
    int64_t now = ddx_time_now();
    const char *error;

    if (monitor->surface)
        return true;
    if (monitor->tried && now - monitor->tried < AGAIN_NS)
        return false;
    monitor->tried = now;
    monitor->surface = screen_open(&monitor->choice, &error);
    if (!monitor->surface) {
        complain(monitor, error);
        return false;
    }
    say("shown at %s", screen_name(monitor->surface));
    *monitor->said = 0;
    return true;
}

static void monitor_close(struct monitor *monitor) {
    surface_close(monitor->surface);
    monitor->surface = NULL;
}

/* Close the screen, which was lost for this reason. */
static void monitor_lose(struct monitor *monitor, const char *reason) {
    complain(monitor, reason);
    monitor_close(monitor);
    monitor->tried = ddx_time_now();
}

/* ---- Caption ---- */

#define MARGIN 2 /* pixels, times the scale */
#define GROUND 0x000000
#define PLAIN 0xffffff
#define ALARM 0xffc020

static void write_frame(const struct caption_facts *facts, char *text, size_t size) {
    snprintf(text, size, "%s  frame %d", facts->name, facts->frame);
    if (facts->rate > 0)
        text_append(text, size, "  %.1f/s", facts->rate);
    if (facts->age < SECOND)
        text_append(text, size, "  age %d ms", (int)(facts->age / MS));
    else
        text_append(text, size, "  age %lld s", (long long)(facts->age / SECOND));
    if (facts->writer.counted)
        text_append(text, size, "  lost %llu", (unsigned long long)facts->writer.lost);
}

static void write_missing(const struct caption_facts *facts, char *text, size_t size) {
    time_t begin = time(NULL) - (time_t)(facts->since / SECOND);
    struct tm wall;
    char clock[16] = "";

    if (localtime_r(&begin, &wall))
        strftime(clock, sizeof clock, "%H:%M:%S", &wall);
    snprintf(text, size, "%s since %s (%lld s)", facts->missing, clock, (long long)(facts->since / SECOND));
}

/* Write the lines. `wanted`: with the first one. The second one is written whenever something is missing. */
static struct caption caption_make(const struct caption_facts *facts, bool wanted) {
    struct caption caption = {.line = {"", ""}};

    if (wanted && facts->shown)
        write_frame(facts, caption.line[0], sizeof caption.line[0]);
    if (facts->missing)
        write_missing(facts, caption.line[1], sizeof caption.line[1]);
    return caption;
}

static void caption_draw(const struct caption *caption, const struct canvas *canvas) {
    int scale = text_scale(canvas->height), margin = MARGIN * scale;
    int height = TEXT_CELL_HEIGHT * scale + margin, y = canvas->height;

    for (int i = 1; i >= 0; i--) {
        const char *line = caption->line[i];

        if (!*line)
            continue;
        y -= height;
        struct canvas ground =
            paint_part(canvas, 0, y, (int)strlen(line) * TEXT_CELL_WIDTH * scale + 2 * margin, height);
        paint_all(&ground, GROUND);
        text_write(canvas, margin, y + margin, scale, i ? ALARM : PLAIN, line);
    }
}

/* ---- Player ---- */

#define WAIT 0.1            /* s, of a wait for the next frame; also between checks for a stop */
#define PATIENCE_NS SECOND  /* frames are missing after this time, or after three periods */
#define RATE_SPAN_NS SECOND /* the rate is counted over this time */
#define BACKGROUND 0x000000

enum { LOST_SCREEN, LOST_BAD };
static const char *const reasons[] = {"screen", "bad", NULL};

/* ---- What is missing ---- */

static const char *const absent[] = {[WATCH_NO_STORE] = "no store",
                                     [WATCH_NO_ITEM] = "no item",
                                     [WATCH_NO_VIDEO] = "no video item",
                                     [WATCH_NO_WRITER] = "no writer",
                                     [WATCH_WRITTEN] = "no frame"};

static int64_t patience_of(const struct player *player) {
    return player->rate > 0 && player->rate < 3 ? (int64_t)(3 * (double)SECOND / player->rate) : PATIENCE_NS;
}

/* While frames come, only the store can be missing: frames do not need it. Its report on the writer may be older. */
static void find_missing(const struct player *player, struct caption_facts *facts, int64_t now) {
    enum watch_state state = facts->writer.state;
    int64_t silence = now - player->written;
    bool is_late = silence > patience_of(player), waits = silence > PATIENCE_NS / 4;

    if (player->trouble)
        facts->missing = player->trouble;
    else if (is_late || (waits && state != WATCH_WRITTEN) || (state == WATCH_NO_STORE && facts->writer.since))
        facts->missing = absent[state];
    facts->stale = facts->missing && (player->trouble || is_late || (waits && state != WATCH_NO_STORE));
    facts->since = facts->stale ? silence : now - facts->writer.since;
}

static struct caption_facts facts_of(struct player *player, const struct ddxvideo_picture *picture) {
    int64_t now = ddx_time_now();
    struct caption_facts facts = {.name = player->name, .shown = picture != NULL, .rate = player->rate};

    facts.writer = watch_look(&player->watch);
    find_missing(player, &facts, now);
    if (picture) {
        facts.frame = picture->stamp.frame;
        facts.age = now - (picture->stamp.time && picture->stamp.time <= now ? picture->stamp.time : player->written);
    }
    return facts;
}

/* ---- Drawing ---- */

/* Draws the picture (NULL: none) into locked pixels. 0, or -errno. */
static int draw(struct player *player, const struct canvas *canvas, const struct ddxvideo_picture *picture) {
    const struct caption_facts facts = facts_of(player, picture);
    struct layout layout;
    int error = 0;

    if (picture) {
        layout_fields(&layout, &picture->geometry, player->field, player->fit, canvas->width, canvas->height);
        error = paint_fields(&player->painter, canvas, picture, &layout, BACKGROUND);
    } else {
        paint_all(canvas, BACKGROUND);
    }
    if (facts.stale)
        paint_grey(canvas);
    player->shown = caption_make(&facts, player->text);
    caption_draw(&player->shown, canvas);
    return error;
}

static const struct ddxvideo_picture *still_of(const struct player *player) {
    return player->still.bytes ? &player->still.picture : NULL;
}

/* Draws the kept picture again when the message below it has changed. */
static void draw_still(struct player *player) {
    const struct ddxvideo_picture *picture = still_of(player);
    const struct caption_facts facts = facts_of(player, picture);
    const struct caption caption = caption_make(&facts, player->text);
    struct canvas canvas;

    if (!strcmp(caption.line[1], player->shown.line[1]))
        return;
    const char *wrong = surface_lock(player->monitor.surface, &canvas);
    if (!wrong) {
        draw(player, &canvas, picture);
        wrong = surface_show(player->monitor.surface);
    }
    if (wrong)
        monitor_lose(&player->monitor, wrong);
}

/* ---- Frames ---- */

static void count_rate(struct player *player) {
    int64_t span = player->written - player->counted;

    if (player->first && player->sequence > player->first && span < RATE_SPAN_NS)
        return;
    player->rate = player->first && player->sequence > player->first
                       ? (double)(player->sequence - player->first) * (double)SECOND / (double)span
                       : 0;
    player->first = player->sequence;
    player->counted = player->written;
}

/* Counts a frame at its first use; the frames between it and the previous one were skipped. */
static void count_in(struct player *player, const struct ddx_frame *frame, bool fresh) {
    int64_t now = ddx_time_now();

    if (player->sequence && frame->sequence > player->sequence)
        ddx_stats_skipped(player->book, frame->sequence - player->sequence - 1);
    ddx_stats_in(player->book, 1, frame->sequence);
    player->sequence = frame->sequence;
    player->written = fresh || frame->time > now ? now : frame->time;
    player->kept = false;
    count_rate(player);
}

static void count_out(struct player *player, int error, const char *wrong, const struct ddx_frame *frame) {
    if (error)
        ddx_stats_lost(player->book, LOST_BAD, 1);
    else if (wrong)
        ddx_stats_lost(player->book, LOST_SCREEN, 1);
    else
        ddx_stats_out(player->book, 1, ddx_time_now() - frame->time);
}

/* Reports, once, why frames cannot be read. */
static void note(struct player *player, int error) {
    const char *text = error && error != -ETIMEDOUT && error != -ECONNREFUSED ? as_420_error(error) : NULL;

    if (text && text != player->trouble)
        say("%s: %s", player->name, text);
    player->trouble = text;
}

/* The picture of a held frame in 4:2:0, valid until the next call or the frame's release. 0, or -errno. */
static int view(struct player *player, const struct ddx_frame *frame, struct ddxvideo_picture *picture) {
    const struct ddxvideo_picture *shown = picture;
    int error = ddxvideo_view_any(player->item, frame->data, picture);

    if (!error)
        error = as_420(&player->as, picture, &shown);
    *picture = *shown;
    return error;
}

/* Draws a held frame into locked pixels. 0, or -errno. */
static int draw_held(struct player *player, const struct canvas *canvas, const struct ddx_frame *frame) {
    struct ddxvideo_picture picture;
    int error = view(player, frame, &picture);

    note(player, error);
    if (error) {
        draw(player, canvas, still_of(player));
        return error;
    }
    error = draw(player, canvas, &picture);
    note(player, error);
    return error;
}

/*
 * Shows the newest frame, or the kept picture; `fresh`: the frame was just written. The frame is taken when the screen
 * is ready, since a newer one may come until then.
 */
static void show_newest(struct player *player, bool fresh) {
    struct canvas canvas;
    struct ddx_frame frame;
    const char *wrong = surface_lock(player->monitor.surface, &canvas);
    bool counts = false;
    int error = 0;

    if (!wrong && player->item && !ddx_store_acquire(player->item, &frame, 0, DDX_CURRENT)) {
        counts = frame.sequence != player->sequence;
        if (counts)
            count_in(player, &frame, fresh);
        error = draw_held(player, &canvas, &frame);
        ddx_store_release(player->item);
    } else if (!wrong) {
        draw(player, &canvas, still_of(player));
    }
    if (!wrong)
        wrong = surface_show(player->monitor.surface);
    if (counts)
        count_out(player, error, wrong, &frame);
    if (wrong)
        monitor_lose(&player->monitor, wrong);
}

/* Keeps a copy when the next frame is late: if the store exits, the frame is lost with it. */
static void keep(struct player *player) {
    struct ddxvideo_picture picture;
    struct ddx_frame frame;

    if (player->kept || !player->item || ddx_store_acquire(player->item, &frame, 0, DDX_CURRENT))
        return;
    if (frame.sequence == player->sequence) {
        player->kept = true;
        if (!view(player, &frame, &picture))
            still_take(&player->still, &picture);
    }
    ddx_store_release(player->item);
}

/* ---- The loop ---- */

/* False: the program cannot continue. */
static bool connect_store(struct player *player) {
    if (!player->id) {
        player->id = ddx_store_open(NULL, (int)player->program.port, 0);
        if (player->id && !program_attach(&player->program, player->book, player->id, player->name))
            return false;
    }
    if (player->id && !player->item) {
        player->item = ddx_store_await_item(player->id, player->name);
        if (!player->item)
            note(player, -errno);
    }
    return true;
}

/* Waits a moment for the next frame. False: none came. */
static bool wait_for_frame(struct player *player) {
    struct ddx_frame frame;
    int error = player->item ? ddx_store_acquire(player->item, &frame, WAIT, DDX_NEXT) : -ECONNREFUSED;

    if (!error) {
        ddx_store_release(player->item);
        return true;
    }
    if (error != -ETIMEDOUT) {
        note(player, error);
        if (error != -ECONNREFUSED) { /* an item of the same name may have another type later */
            ddx_store_done_item(player->item);
            player->item = NULL;
        }
        program_sleep_until(ddx_time_now() + (int64_t)(WAIT * (double)SECOND), player->book);
    }
    return false;
}

static void step(struct player *player) {
    bool dark = !player->monitor.surface;

    if (!has_screen(&player->monitor)) {
        program_sleep_until(ddx_time_now() + (int64_t)(WAIT * (double)SECOND), player->book);
        return;
    }
    bool fresh = !dark && wait_for_frame(player);
    if (dark || fresh) {
        show_newest(player, fresh);
    } else {
        keep(player);
        draw_still(player);
    }
}

int player_run(struct player *player) {
    int status = EXIT_OK;

    player->book = program_book(&player->program, reasons);
    player->watch.name = player->name;
    player->watch.port = player->program.port;
    player->written = ddx_time_now();
    if (watch_start(&player->watch)) {
        say("out of memory");
        return EXIT_FAILED;
    }
    for (; !program_stopping() && !status; program_tick(player->book)) {
        if (connect_store(player))
            step(player);
        else
            status = EXIT_FAILED;
    }
    monitor_close(&player->monitor);
    program_report(player->book);
    ddx_stats_close(player->book);
    watch_stop(&player->watch);
    ddx_store_done_item(player->item);
    ddx_store_close(player->id);
    paint_close(&player->painter);
    as_420_close(&player->as);
    still_close(&player->still);
    return status;
}
