/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "grabber.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <string.h>

#include "geometry.h"
#include "publish.h"
#include "settings.h"

static const char *const reasons[] = {"driver", "error", "away", "store", NULL};

#define MS INT64_C(1000000)
#define SECOND (1000 * MS)
#define UNPLUGGED "unplugged, waiting for it"
#define LASTS_NS SECOND
#define RETRY_NS (200 * MS)     /* between two attempts to open the camera */
#define POLL_MS 50              /* longest sleep: requests and signals are looked for as often */
#define PATIENCE_NS SECOND      /* without a frame, the stream is begun anew; of a slow camera, four periods */
#define WARM_UP_NS (3 * SECOND) /* the same before the first frame: some cameras need as long */
#define LOST_SAID_NS (10 * SECOND)
#define ORDER_NS (50 * MS) /* or half a period: longest that a frame waits for one before it */
#define TIME_OFF_NS (2 * SECOND) /* a driver's time that is farther from now is none */

static bool quit(const struct grabber *grabber) {
    return program_stopping() || !grabber->id;
}

/* One line for each new state, however often it is found. */
static void set_state(struct grabber *grabber, const char *state) {
    if (strcmp(grabber->state, state) != 0)
        say("%s: %s", grabber->wish.path, state);
    snprintf(grabber->state, sizeof grabber->state, "%s", state);
}

/* What keeps the camera from being opened is told when it lasts: a device that appears is not ours at first. */
static void set_reason(struct grabber *grabber, int error, const char *why) {
    int64_t now = ddx_time_now();

    if (strcmp(grabber->reason, why) != 0) {
        snprintf(grabber->reason, sizeof grabber->reason, "%s", why);
        grabber->since = now;
    }
    bool missing = error == -ENOENT || error == -ENODEV || error == -ENXIO;
    bool known = missing && !strcmp(grabber->state, UNPLUGGED);
    if (!known && now - grabber->since >= LASTS_NS)
        set_state(grabber, why);
}

/* ---- While the camera is away ---- */

/*
 * Frames that the camera would have given since the last one: nobody numbers them, so they are counted by the clock.
 * `margin` periods are left out as long as it is not known when the next frame comes.
 */
static void count_away(struct grabber *grabber, int64_t now, double margin) {
    if (!grabber->last || !grabber->period)
        return;
    double periods = (double)(now - grabber->last) / (double)grabber->period - margin;
    uint64_t frames = periods > 0 ? (uint64_t)periods : 0;
    if (frames <= grabber->away)
        return;
    uint64_t wanted = count_pass(&grabber->count, frames - grabber->away);
    grabber->away = frames;
    ddx_stats_in(grabber->book, wanted, 0);
    ddx_stats_lost(grabber->book, LOST_AWAY, wanted);
}

static void let_go(struct grabber *grabber, const char *why) {
    set_state(grabber, why);
    converter_close(&grabber->converter);
    device_close(&grabber->device);
    grabber->back = false;
    grabber->retry = ddx_time_now() + RETRY_NS;
}

static void try_open(struct grabber *grabber) {
    char why[256] = "";
    int64_t now = ddx_time_now();

    if (now < grabber->retry)
        return;
    grabber->retry = now + RETRY_NS;
    int error = device_open(&grabber->device, &grabber->wish, why, sizeof why);
    if (error) {
        set_reason(grabber, error, why);
        return;
    }
    *grabber->reason = 0;
    const struct device_wish *wish = &grabber->wish;
    grabber->geometry =
        geometry_of_result(&grabber->device.geometry, wish->width, wish->height, grabber->skip, grabber->stack);
    const char *bad = ddxvideo_geometry_error(&grabber->geometry);
    error = bad ? -EINVAL
                : converter_open(&grabber->converter, &grabber->device.pixels, grabber->geometry.width,
                                 grabber->geometry.height, grabber->stack);
    if (error) {
        let_go(grabber, bad ? bad : "its pictures cannot be converted");
        return;
    }
    const struct ddxvideo_geometry *camera = &grabber->device.geometry;
    grabber->period = camera->rate_num ? SECOND * camera->rate_den / camera->rate_num : 0;
    grabber->silent = 0;
    count_restart(&grabber->count);
    order_restart(&grabber->order);
    settings_begin(grabber);
}

/* ---- Frame by frame ---- */

/* When the frame was captured: as the driver says, if it counts the same time as we do. */
static int64_t time_of(struct grabber *grabber, const struct v4l2_buffer *buffer, int64_t now) {
    int64_t time = buffer->timestamp.tv_sec * SECOND + buffer->timestamp.tv_usec * 1000;
    bool monotonic = (buffer->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;

    if (monotonic && time > now - TIME_OFF_NS && time < now + TIME_OFF_NS)
        return time;
    if (!grabber->odd_times)
        say("%s: the driver's times are not of this machine's clock; taking those of arrival", grabber->wish.path);
    grabber->odd_times = true;
    return now;
}

/* The first frame since the camera was opened. */
static void welcome(struct grabber *grabber, int64_t time) {
    const struct ddxvideo_geometry *from = &grabber->device.geometry, *to = &grabber->geometry;
    uint64_t before = grabber->away;

    count_away(grabber, time, 0.5);
    if (grabber->last && (*grabber->state || grabber->away > before))
        say("%s: back after %.1f s", grabber->wish.path, (double)(time - grabber->last) / 1e9);
    else
        say("%s: %s, %s %dx%d, to %s %dx%d", grabber->wish.path, grabber->device.card,
            pixels_find(grabber->device.pixels.fourcc)->name, from->width, from->height, grabber->name, to->width,
            to->height);
    *grabber->state = 0;
    grabber->away = 0;
    grabber->back = true;
}

static void count_lost(struct grabber *grabber, uint64_t frames, int64_t now) {
    ddx_stats_in(grabber->book, frames, 0);
    ddx_stats_lost(grabber->book, LOST_DRIVER, frames);
    if (grabber->count.lost == grabber->lost_said || (grabber->lost_when && now < grabber->lost_when + LOST_SAID_NS))
        return;
    say("%s: the driver lost %" PRIu64 " frames", grabber->wish.path, grabber->count.lost - grabber->lost_said);
    grabber->lost_said = grabber->count.lost;
    grabber->lost_when = now;
}

static void handle(struct grabber *grabber, const struct v4l2_buffer *buffer) {
    bool wanted;
    uint64_t position;
    int64_t now = ddx_time_now(), time = time_of(grabber, buffer, now);

    if (!grabber->back)
        welcome(grabber, time);
    uint64_t lost = count_frame(&grabber->count, buffer->sequence, &wanted, &position);
    count_lost(grabber, lost, now);
    if (!grabber->device.geometry.rate_num && grabber->last) /* the driver does not tell its rate */
        grabber->period = time - grabber->last;
    grabber->last = time;
    grabber->silent = 0;
    if (!wanted) {
        ddx_stats_skipped(grabber->book, 1);
        return;
    }
    if (buffer->flags & V4L2_BUF_FLAG_ERROR) {
        ddx_stats_in(grabber->book, 1, 0);
        ddx_stats_lost(grabber->book, LOST_ERROR, 1);
    } else {
        publish(grabber, buffer, position, time);
    }
    ddx_stats_write(grabber->book);
}

/* How long a frame waits for one before it. */
static int64_t patience_for_order(const struct grabber *grabber) {
    return grabber->period > 0 && grabber->period < 2 * ORDER_NS ? grabber->period / 2 : ORDER_NS;
}

/* All whose turn it is; 0, or what giving them back to the driver ended with. */
static int handle_due(struct grabber *grabber, int64_t now) {
    unsigned slot;

    while (order_next(&grabber->order, now, patience_for_order(grabber), &slot)) {
        handle(grabber, &grabber->taken[slot]);
        int error = device_give(&grabber->device, &grabber->taken[slot]);
        if (error)
            return error;
    }
    return 0;
}

/* All frames that are there. */
static void take_frames(struct grabber *grabber) {
    struct v4l2_buffer buffer;
    int error;

    while (!(error = device_take(&grabber->device, &buffer))) {
        int64_t now = ddx_time_now();

        grabber->taken[buffer.index] = buffer;
        bool in_time = order_add(&grabber->order, buffer.sequence, buffer.index, now);
        error = in_time ? handle_due(grabber, now) : device_give(&grabber->device, &buffer);
        if (error)
            break;
    }
    if (error == -EAGAIN) {
        int given = handle_due(grabber, ddx_time_now());

        error = given ? given : error;
    }
    if (error == -ENODEV)
        let_go(grabber, UNPLUGGED);
    else if (error != -EAGAIN)
        let_go(grabber, "the stream broke off, beginning anew");
}

/* What the driver tells beside the frames. */
static void take_events(struct grabber *grabber) {
    struct v4l2_event event;

    while (!device_ioctl(grabber->device.fd, VIDIOC_DQEVENT, &event)) {
        if (event.type == V4L2_EVENT_SOURCE_CHANGE) {
            let_go(grabber, "another signal, looking what it is");
            grabber->retry = 0;
            return;
        }
        controls_follow(&grabber->controls, grabber->device.fd, event.id);
        grabber->changed = true;
    }
}

static void stream(struct grabber *grabber) {
    struct pollfd look = {.fd = grabber->device.fd, .events = POLLIN | POLLPRI};
    int64_t begin = ddx_time_now(), due = order_due(&grabber->order, patience_for_order(grabber));
    int wait = due > begin + POLL_MS * MS ? POLL_MS : due > begin ? (int)((due - begin + MS - 1) / MS) : 0;
    int ready = poll(&look, 1, wait);

    if (ready > 0 && look.revents & POLLPRI)
        take_events(grabber);
    if (((ready > 0 && look.revents & ~POLLPRI) || grabber->order.count) && grabber->device.fd >= 0)
        take_frames(grabber);
    if (grabber->device.fd < 0)
        return;
    int64_t patience = grabber->back ? PATIENCE_NS : WARM_UP_NS;
    if (patience < 4 * grabber->period)
        patience = 4 * grabber->period;
    /* When it took longer than that, it was not the camera that stood still. */
    int64_t looked = ddx_time_now() - begin;
    grabber->silent += looked < 2 * POLL_MS * MS ? looked : 2 * POLL_MS * MS;
    if (grabber->silent > patience)
        let_go(grabber, "gives no frames, waiting for them");
}

static void grab(struct grabber *grabber) {
    while (!quit(grabber)) {
        if (grabber->device.fd < 0)
            try_open(grabber);
        if (grabber->device.fd >= 0)
            stream(grabber);
        else
            program_sleep_until(ddx_time_now() + POLL_MS * MS, grabber->book);
        settings_tick(grabber);
        if (!grabber->back)
            count_away(grabber, ddx_time_now(), 2);
        program_tick(grabber->book);
    }
    if (grabber->device.fd >= 0)
        handle_due(grabber, INT64_MAX);
}

int grabber_run(struct grabber *grabber) {
    int status = EXIT_OK;

    grabber->device.fd = -1;
    grabber->count.skip = (uint64_t)grabber->skip;
    grabber->book = ddx_stats_open(grabber->program.instance, reasons);
    if (!grabber->book) {
        say("-instance %s: %s", grabber->program.instance, ddx_error_text(-errno));
        return EXIT_USAGE;
    }
    grabber->id = program_connect(&grabber->program);
    if (grabber->id && !program_attach(&grabber->program, grabber->book, grabber->id, NULL))
        status = EXIT_FAILED;
    else
        grab(grabber);
    converter_close(&grabber->converter);
    device_close(&grabber->device);
    program_report(grabber->book);
    ddx_stats_close(grabber->book);
    settings_end(grabber);
    publish_end(grabber);
    ddx_store_close(grabber->id);
    return status;
}
