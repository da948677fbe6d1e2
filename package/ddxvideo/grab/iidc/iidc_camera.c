/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "iidc_camera.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "counter.h"
#include "iidc_controls.h"
#include "library_log.h"

#define SECOND INT64_C(1000000000)
#define AGAIN_NS (3 * SECOND)       /* between attempts while the buses do not change */
#define ANSWER_NS (SECOND * 9 / 10) /* libdc1394 waits one second for an answer */
#define BUFFER_MEMORY (6 << 20)     /* of the kernel's 16 MiB for all USB devices */
#define FEW_BUFFERS 3

static struct iidc_camera *iidc_of(struct camera *camera) {
    return (struct iidc_camera *)camera;
}

static void iidc_close(struct camera *camera) {
    struct iidc_camera *iidc = iidc_of(camera);

    library_log_mute(iidc->gone);
    if (iidc->capturing) {
        dc1394_video_set_transmission(iidc->device, DC1394_OFF);
        dc1394_capture_stop(iidc->device);
    }
    bus_close(iidc->library, iidc->device);
    library_log_mute(false);
    iidc->library = NULL;
    iidc->device = NULL;
    iidc->capturing = false;
    camera->fd = -1;
}

static uint32_t buffers_for(const struct pixels *pixels) {
    int bytes = pixels->stride * pixels->height, buffers = BUFFER_MEMORY / bytes;

    return (uint32_t)(buffers < FEW_BUFFERS ? FEW_BUFFERS : buffers > IIDC_BUFFERS ? IIDC_BUFFERS : buffers);
}

static int start(struct iidc_camera *iidc, char *why, size_t size) {
    dc1394error_t error = dc1394_capture_setup(iidc->device, buffers_for(&iidc->camera.pixels),
                                               DC1394_CAPTURE_FLAGS_DEFAULT);

    iidc->capturing = !error;
    if (!error)
        error = dc1394_video_set_transmission(iidc->device, DC1394_ON);
    if (!error)
        return 0;
    snprintf(why, size, "does not start: %s",
             error == DC1394_NO_BANDWIDTH ? "no bandwidth is left on its bus; a lower -rate takes less"
                                          : dc1394_error_get_string(error));
    return -EIO;
}

/* Starts to number the frames by their times, unless an external trigger starts them. */
static void keep_pace(struct iidc_camera *iidc, int64_t period) {
    dc1394bool_t there = DC1394_FALSE;
    dc1394switch_t on = DC1394_OFF;

    if (!dc1394_feature_is_present(iidc->device, DC1394_FEATURE_TRIGGER, &there) && there)
        dc1394_external_trigger_get_power(iidc->device, &on);
    iidc->camera.triggered = on == DC1394_ON;
    pace_restart(&iidc->pace, iidc->camera.triggered ? PACE_NONE : period);
}

static void take_over(struct iidc_camera *iidc, const struct setup *setup) {
    struct camera *camera = &iidc->camera;
    const char *vendor = iidc->device->vendor, *model = iidc->device->model;
    const struct ddxvideo_geometry *given = &setup->geometry;

    camera->pixels = setup->pixels;
    camera->geometry = setup->geometry;
    snprintf(camera->card, sizeof camera->card, "%s%s%s", vendor ? vendor : "", vendor && model ? " " : "",
             model ? model : "");
    iidc->counts = counter_switch(iidc->device, setup->eight_bits);
    keep_pace(iidc, given->rate_num ? SECOND * given->rate_den / given->rate_num : 0);
}

static int open_now(struct iidc_camera *iidc, char *why, size_t size) {
    struct setup setup;

    iidc->gone = false;
    int error = bus_open(&iidc->bus, &iidc->library, &iidc->device, why, size);
    if (error)
        return error;
    snprintf(iidc->name, sizeof iidc->name, "camera %016" PRIx64, iidc->bus.guid);
    error = setup_camera(iidc->device, &iidc->wish, &setup, why, size);
    if (!error) {
        take_over(iidc, &setup);
        error = start(iidc, why, size);
    }
    if (error) {
        iidc_close(&iidc->camera);
        return error;
    }
    iidc->camera.fd = dc1394_capture_get_fileno(iidc->device);
    library_log_forget();
    return 0;
}

/*
 * The grabber tries often, but each attempt with a camera that does not answer takes a second and disturbs the other
 * cameras on the buses. So while no device comes or goes, the last reason is repeated for some seconds.
 */
static int iidc_open(struct camera *camera, char *why, size_t size) {
    struct iidc_camera *iidc = iidc_of(camera);
    uint64_t devices = bus_devices();

    if (!iidc->error || devices != iidc->devices || ddx_time_now() > iidc->tried + AGAIN_NS) {
        *iidc->why = 0;
        iidc->error = open_now(iidc, iidc->why, sizeof iidc->why);
        iidc->devices = devices;
        iidc->files = bus_files();
        iidc->tried = ddx_time_now();
    }
    if (iidc->error)
        snprintf(why, size, "%s", iidc->why);
    return iidc->error;
}

/*
 * Interprets a failure: a camera that is unplugged or no longer answers is gone; any other camera has lost its stream.
 * Access to an unplugged camera fails at once.
 */
static int fate(struct iidc_camera *iidc) {
    dc1394switch_t on;
    int64_t begin = ddx_time_now();

    library_log_mute(true);
    if (!iidc->gone && dc1394_video_get_transmission(iidc->device, &on)) {
        iidc->gone = true;
        iidc->unplugged = ddx_time_now() < begin + ANSWER_NS || bus_files() != iidc->files;
    }
    library_log_mute(false);
    return iidc->gone && iidc->unplugged ? -ENODEV : -EIO;
}

/* The frame's number: by the camera's counter, or by the frame's time. */
static uint32_t number_of(struct iidc_camera *iidc, dc1394video_frame_t *frame, bool damaged, int64_t time) {
    if (iidc->counts && !damaged)
        return iidc->pace.number = counter_take(frame);
    if (iidc->counts)
        return ++iidc->pace.number;
    if (frame->bus_cycle)
        return pace_bus_number(&iidc->pace, frame->bus_cycle, time);
    return pace_number(&iidc->pace, time, frame->frames_behind > 0);
}

static int iidc_take(struct camera *camera, int64_t now, struct camera_frame *frame) {
    struct iidc_camera *iidc = iidc_of(camera);
    dc1394video_frame_t *got = NULL;

    if (now == INT64_MAX)
        return -EAGAIN;
    if (dc1394_capture_dequeue(iidc->device, DC1394_CAPTURE_POLICY_POLL, &got))
        return fate(iidc);
    if (!got)
        return -EAGAIN;
    iidc->gone = false; /* it has missed only one access */
    bool damaged = dc1394_capture_is_frame_corrupt(iidc->device, got) || got->total_bytes < got->image_bytes;
    int64_t time = wall_time(&iidc->wall, got->timestamp, now, ddxvideo_wall_offset());
    *frame = (struct camera_frame){.data = got->image,
                                   .size = got->image_bytes,
                                   .time = time,
                                   .damaged = damaged,
                                   .sequence = number_of(iidc, got, damaged, time ? time : now),
                                   .slot = got->id % IIDC_BUFFERS};
    iidc->taken[frame->slot] = got;
    return 0;
}

static int iidc_give(struct camera *camera, const struct camera_frame *frame) {
    struct iidc_camera *iidc = iidc_of(camera);

    return dc1394_capture_enqueue(iidc->device, iidc->taken[frame->slot]) ? fate(iidc) : 0;
}

static int64_t iidc_due(const struct camera *camera) {
    (void)camera;
    return INT64_MAX;
}

static void iidc_list(struct camera *camera, struct controls *controls) {
    features_list(iidc_of(camera)->device, controls);
}

static void iidc_refresh(struct camera *camera, struct controls *controls) {
    features_refresh(iidc_of(camera)->device, controls);
}

static int iidc_set(struct camera *camera, uint32_t id, int value) {
    struct iidc_camera *iidc = iidc_of(camera);

    if (iidc->gone)
        return -ENODEV;
    int error = features_set(iidc->device, id, value);
    if (error == -EIO && fate(iidc) == -ENODEV)
        return -ENODEV;
    if (!error && features_changes_rate(id))
        keep_pace(iidc, 0);
    return error;
}

void iidc_camera_init(struct iidc_camera *iidc) {
    static const struct camera_functions functions = {.open = iidc_open,
                                                      .close = iidc_close,
                                                      .take = iidc_take,
                                                      .give = iidc_give,
                                                      .due = iidc_due,
                                                      .list = iidc_list,
                                                      .refresh = iidc_refresh,
                                                      .set = iidc_set};

    *iidc = (struct iidc_camera){.camera = {.call = &functions, .name = iidc->name, .fd = -1}};
    library_log_begin();
}
