/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "grabber.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <string.h>

#include "ddx_time.h"
#include "geometry.h"

/* Reasons of loss, in the order of the names given to ddx_stats_open(). */
enum { LOST_DRIVER, LOST_ERROR, LOST_AWAY, LOST_STORE };

/* ---- Frames into the store ---- */

#define CREATE_AGAIN_NS INT64_C(500000000)

/* Reports each new error of the store once; 0: none. */
static void complain(const struct grabber *grabber, const char *item, int error) {
    static int said;

    if (error == -EPROTOTYPE && !*item && error != said)
        say("%s: its readers have it open in a layout other than %s; restart them, until then its frames are lost",
            grabber->name, grabber->camera->layout->name);
    else if (error && error != said)
        say("%s%s: %s", grabber->name, item, ddx_error_text(error));
    said = error;
}

/* Creates the items for the current geometry, if needed. False if that is not possible now. */
static bool have_items(struct grabber *grabber) {
    const struct ddxvideo_geometry *wanted = &grabber->geometry;
    int64_t now = ddx_time_now();
    const struct ddxvideo_geometry *made = &grabber->created;
    bool same_size = wanted->width == made->width && wanted->height == made->height;

    if (grabber->video && same_size && video_layout_of(wanted->format) == video_layout_of(made->format))
        return true;
    if (now < grabber->create)
        return false;
    grabber->create = now + CREATE_AGAIN_NS;
    ddx_store_done_item(grabber->video);
    grabber->video = NULL;
    int error = ddxvideo_create(grabber->id, grabber->name, wanted, &grabber->video);
    if (error) {
        complain(grabber, "", error);
        return false;
    }
    if (!grabber->created.width)
        ddx_stats_published(grabber->book, ddx_store_written(grabber->video));
    grabber->created = *wanted;
    if (!grabber->counter)
        error = ddxvideo_counter_create(grabber->id, grabber->name, &grabber->counter);
    complain(grabber, ".frame", error);
    return true;
}

static int write_frame(struct grabber *grabber, const struct camera_frame *from, uint64_t position, int64_t time) {
    struct ddxvideo_frame frame;
    int error = ddxvideo_loan(grabber->video, &grabber->geometry, &frame);

    if (error)
        return error;
    error = converter_run(&grabber->converter, from->data, from->size, frame.plane, frame.stride);
    if (error) {
        ddx_store_cancel(grabber->video);
        return error;
    }
    frame.stamp = (struct ddxvideo_stamp){.frame = (int)(position & INT32_MAX),
                                          .time = time,
                                          .wall_offset = ddxvideo_wall_offset(),
                                          .source_sequence = from->sequence,
                                          .source_lost = (int64_t)grabber->count.lost};
    ddx_stats_publishing(grabber->book, ddx_store_written(grabber->video) + 1);
    error = ddxvideo_publish(grabber->video, &frame);
    if (!error && grabber->counter)
        ddxvideo_counter_write(grabber->counter, frame.stamp.frame);
    return error;
}

/* Convert a wanted frame into the store, and count it. `time`: of its capture. */
static void publish(struct grabber *grabber, const struct camera_frame *from, uint64_t position, int64_t time) {
    ddx_stats_in(grabber->book, 1, 0);
    if (!have_items(grabber)) {
        ddx_stats_lost(grabber->book, LOST_STORE, 1);
        return;
    }
    int error = write_frame(grabber, from, position, time);
    if (!error)
        ddx_stats_out(grabber->book, 1, ddx_time_now() - time);
    else if (error == -EBADMSG)
        ddx_stats_lost(grabber->book, LOST_ERROR, 1);
    else
        ddx_stats_lost(grabber->book, LOST_STORE, 1);
    if (error != -EBADMSG)
        complain(grabber, "", error);
}

/* Close the items. */
static void publish_end(struct grabber *grabber) {
    ddx_store_done_item(grabber->counter);
    ddx_store_done_item(grabber->video);
}

/* ---- Settings ---- */

/* The camera's settings in the store: item `<name>.parameters`, and requests. */

#define AGAIN_NS INT64_C(100000000)    /* some cameras change a control with each frame */
#define REFUSED_NS INT64_C(1000000000) /* between two attempts to create an item that the store refuses */

/* Call when the camera was opened. */
static void settings_begin(struct grabber *grabber) {
    controls_begin(&grabber->controls, grabber->camera);
    grabber->changed = true;
    grabber->settings = 0;
}

static void serve(struct grabber *grabber) {
    DDX_REQUEST request;
    char text[DDX_ANSWER_TEXT] = "";
    int status;

    if (ddx_requests_take(grabber->requests, &request))
        return;
    if (!camera_is_open(grabber->camera)) {
        status = -ENODEV;
        snprintf(text, sizeof text, "the camera is not there now: %.128s", grabber->state);
    } else {
        status = controls_change(&grabber->controls, grabber->camera, &request, text);
        grabber->changed = true;
    }
    /* Before the answer, so that a program that gets it finds the new values. */
    if (!status && grabber->parameters && !ddxvideo_parameters_write(grabber->parameters, &grabber->controls.list))
        grabber->changed = false;
    ddx_requests_answer(grabber->requests, status, text);
}

/* Creates the two items, if needed; reports each new error once. 0 or -errno. */
static int open_items(struct grabber *grabber) {
    static int said;
    int error = 0;

    if (!grabber->parameters)
        error = ddxvideo_parameters_create(grabber->id, grabber->name, &grabber->parameters);
    bool refused = error;
    if (!grabber->requests && !(grabber->requests = ddx_requests_open(grabber->id, grabber->name)))
        error = -errno;
    if (error && error != said)
        say("%s%s: %s", grabber->name, refused ? ".parameters" : ": its settings cannot be changed",
            ddx_error_text(error));
    said = error;
    return error;
}

/* Answer a request, if there is one; write the parameters, if they have changed. Call it often. */
static void settings_tick(struct grabber *grabber) {
    int64_t now = ddx_time_now();

    if (grabber->requests)
        serve(grabber);
    if (!grabber->changed || now < grabber->settings)
        return;
    grabber->settings = now + (open_items(grabber) ? REFUSED_NS : AGAIN_NS);
    if (grabber->parameters && !ddxvideo_parameters_write(grabber->parameters, &grabber->controls.list))
        grabber->changed = grabber->requests == NULL;
}

/* Close the items. */
static void settings_end(struct grabber *grabber) {
    ddx_requests_close(grabber->requests);
    ddx_store_done_item(grabber->parameters);
}

/* ---- Grabber ---- */

static const char *const reasons[] = {"driver", "error", "away", "store", NULL};

#define UNPLUGGED "unplugged, waiting for it"
#define LASTS_NS SECOND
#define RETRY_NS (200 * MS)     /* between two attempts to open the camera */
#define POLL_MS 50              /* longest wait; requests and signals are checked after it */
#define PATIENCE_NS SECOND      /* without a frame; then the stream is restarted. For a slow camera, four periods */
#define WARM_UP_NS (3 * SECOND) /* the same before the first frame: some cameras take that long */
#define LOST_SAID_NS (10 * SECOND)

static bool quit(const struct grabber *grabber) {
    return program_stopping() || !grabber->id;
}

/* One line for each new state, however often it is found. */
static void set_state(struct grabber *grabber, const char *state) {
    if (strcmp(grabber->state, state) != 0)
        say("%s: %s", grabber->camera->name, state);
    snprintf(grabber->state, sizeof grabber->state, "%s", state);
}

/* A reason that prevents opening is reported when it lasts: a new device does not belong to this user at first. */
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
 * Counts, by the clock, the frames that the camera would have sent since the last one. `margin` periods are left out
 * while the time of the next frame is unknown.
 */
static void count_away(struct grabber *grabber, int64_t now, double margin) {
    if (!grabber->last || !grabber->camera->period)
        return;
    double periods = (double)(now - grabber->last) / (double)grabber->camera->period - margin;
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
    grabber->camera->call->close(grabber->camera);
    grabber->back = false;
    grabber->retry = ddx_time_now() + RETRY_NS;
}

static void try_open(struct grabber *grabber) {
    char why[256] = "";
    int64_t now = ddx_time_now();

    if (now < grabber->retry)
        return;
    grabber->retry = now + RETRY_NS;
    grabber->opened = now;
    int error = grabber->camera->call->open(grabber->camera, why, sizeof why);
    if (error) {
        set_reason(grabber, error, why);
        return;
    }
    *grabber->reason = 0;
    struct camera *camera = grabber->camera;
    grabber->geometry = geometry_of_result(&camera->geometry, camera->width, camera->height, grabber->skip,
                                           grabber->stack, camera->layout);
    const char *bad = ddxvideo_geometry_error(&grabber->geometry);
    error = bad ? -EINVAL
                : converter_open(&grabber->converter, &camera->pixels, camera->geometry.range, &grabber->geometry,
                                 grabber->stack);
    if (error) {
        let_go(grabber, bad ? bad : "its pictures cannot be converted");
        return;
    }
    const struct ddxvideo_geometry *given = &camera->geometry;
    camera->period = given->rate_num ? SECOND * given->rate_den / given->rate_num : 0;
    grabber->silent = 0;
    count_restart(&grabber->count);
    settings_begin(grabber);
}

/* ---- Frame by frame ---- */

/* The capture time of the frame: the camera's, if it is of this machine's clock. */
static int64_t time_of(struct grabber *grabber, const struct camera_frame *frame, int64_t now) {
    int64_t time = count_time(frame->time, grabber->opened, now);

    if (time == frame->time)
        return time;
    if (!grabber->odd_times)
        say("%s: the driver's times are not of this machine's clock; taking those of arrival", grabber->camera->name);
    grabber->odd_times = true;
    return time;
}

/* The first frame since the camera was opened. */
static void welcome(struct grabber *grabber, int64_t time) {
    const struct ddxvideo_geometry *from = &grabber->camera->geometry, *to = &grabber->geometry;
    uint64_t before = grabber->away;

    count_away(grabber, time, 0.5);
    if (grabber->last && (*grabber->state || grabber->away > before))
        say("%s: back after %.1f s", grabber->camera->name, (double)(time - grabber->last) / 1e9);
    else
        say("%s: %s, %s %dx%d, to %s %dx%d", grabber->camera->name, grabber->camera->card,
            pixels_find(grabber->camera->pixels.coding)->name, from->width, from->height, grabber->name, to->width,
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
    say("%s: the driver lost %" PRIu64 " frames", grabber->camera->name, grabber->count.lost - grabber->lost_said);
    grabber->lost_said = grabber->count.lost;
    grabber->lost_when = now;
}

static void handle(struct grabber *grabber, const struct camera_frame *frame) {
    bool wanted;
    uint64_t position;
    int64_t now = ddx_time_now(), time = time_of(grabber, frame, now);

    if (!grabber->back)
        welcome(grabber, time);
    uint64_t lost = count_frame(&grabber->count, frame->sequence, &wanted, &position);
    count_lost(grabber, lost, now);
    struct camera *camera = grabber->camera;
    if (!camera->geometry.rate_num)
        camera->period = count_period(&grabber->count, position, time, camera->period);
    grabber->last = time;
    grabber->silent = 0;
    if (!wanted) {
        ddx_stats_skipped(grabber->book, 1);
        return;
    }
    if (frame->damaged) {
        ddx_stats_in(grabber->book, 1, 0);
        ddx_stats_lost(grabber->book, LOST_ERROR, 1);
    } else {
        publish(grabber, frame, position, time);
    }
    ddx_stats_write(grabber->book);
}

/* Handles all frames that are due. The error of the last take() or give(). */
static int handle_due(struct grabber *grabber, int64_t now) {
    struct camera *camera = grabber->camera;
    struct camera_frame frame;
    int error;

    while (!(error = camera->call->take(camera, now, &frame))) {
        handle(grabber, &frame);
        error = camera->call->give(camera, &frame);
        if (error)
            return error;
        now = now < INT64_MAX ? ddx_time_now() : now;
    }
    return error;
}

/* Handles all frames that have come. */
static void take_frames(struct grabber *grabber) {
    int error = handle_due(grabber, ddx_time_now());

    if (error == -ENODEV)
        let_go(grabber, UNPLUGGED);
    else if (error != -EAGAIN)
        let_go(grabber, "the stream broke off, starting it again");
}

/* Handles events of the camera. */
static void take_events(struct grabber *grabber) {
    switch (grabber->camera->call->events(grabber->camera, &grabber->controls)) {
    case CAMERA_NOTHING: break;
    case CAMERA_CONTROLS_CHANGED: grabber->changed = true; break;
    case CAMERA_OTHER_SIGNAL: let_go(grabber, "another signal, looking what it is"); grabber->retry = 0;
    }
}

static void stream(struct grabber *grabber) {
    struct camera *camera = grabber->camera;
    struct pollfd look = {.fd = camera->fd, .events = POLLIN | (camera->call->events ? POLLPRI : 0)};
    int64_t begin = ddx_time_now(), due = camera->call->due(camera);
    int wait = due > begin + POLL_MS * MS ? POLL_MS : due > begin ? (int)((due - begin + MS - 1) / MS) : 0;
    int ready = poll(&look, 1, wait);

    if (ready > 0 && look.revents & POLLPRI)
        take_events(grabber);
    if (((ready > 0 && look.revents & ~POLLPRI) || due < INT64_MAX) && camera_is_open(camera))
        take_frames(grabber);
    if (!camera_is_open(camera))
        return;
    int64_t patience = grabber->back ? PATIENCE_NS : WARM_UP_NS;
    if (patience < 4 * grabber->camera->period)
        patience = 4 * grabber->camera->period;
    /* A longer wait than that was a stall of this program, not of the camera. */
    int64_t looked = ddx_time_now() - begin;
    grabber->silent += looked < 2 * POLL_MS * MS ? looked : 2 * POLL_MS * MS;
    if (grabber->silent > patience && !camera->triggered)
        let_go(grabber, "gives no frames, waiting for them");
}

static void grab(struct grabber *grabber) {
    while (!quit(grabber)) {
        if (!camera_is_open(grabber->camera))
            try_open(grabber);
        if (camera_is_open(grabber->camera))
            stream(grabber);
        else
            program_sleep_until(ddx_time_now() + POLL_MS * MS, grabber->book);
        settings_tick(grabber);
        if (!grabber->back)
            count_away(grabber, ddx_time_now(), 2);
        program_tick(grabber->book);
    }
    if (camera_is_open(grabber->camera))
        handle_due(grabber, INT64_MAX);
}

int grabber_run(struct grabber *grabber) {
    int status = EXIT_OK;

    grabber->count.skip = (uint64_t)grabber->skip;
    grabber->book = program_book(&grabber->program, reasons);
    grabber->id = program_connect(&grabber->program);
    if (grabber->id && !program_attach(&grabber->program, grabber->book, grabber->id, NULL))
        status = EXIT_FAILED;
    else
        grab(grabber);
    converter_close(&grabber->converter);
    grabber->camera->call->close(grabber->camera);
    program_report(grabber->book);
    ddx_stats_close(grabber->book);
    settings_end(grabber);
    publish_end(grabber);
    ddx_store_close(grabber->id);
    return status;
}
