/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "v4l_camera.h"

#include <errno.h>
#include <stdio.h>

#include "device_open.h"
#include "v4l_controls.h"

#define MS INT64_C(1000000)
#define SECOND (1000 * MS)
#define ORDER_NS (50 * MS) /* or half a period: longest wait of a frame for an earlier one */

static struct v4l_camera *v4l_of(struct camera *camera) {
    return (struct v4l_camera *)camera;
}

static int v4l_open(struct camera *camera, char *why, size_t size) {
    struct v4l_camera *v4l = v4l_of(camera);

    v4l->wish.width = camera->width;
    v4l->wish.height = camera->height;
    v4l->wish.fields = camera->fields;
    v4l->wish.layout = camera->layout;
    int error = device_open(&v4l->device, &v4l->wish, why, size);
    if (error)
        return error;
    camera->fd = v4l->device.fd;
    snprintf(camera->card, sizeof camera->card, "%s", v4l->device.card);
    camera->pixels = v4l->device.pixels;
    camera->geometry = v4l->device.geometry;
    order_restart(&v4l->order);
    return 0;
}

static void v4l_close(struct camera *camera) {
    device_close(&v4l_of(camera)->device);
    camera->fd = -1;
}

/* How long a frame waits for an earlier one. */
static int64_t patience_for_order(const struct camera *camera) {
    return camera->period > 0 && camera->period < 2 * ORDER_NS ? camera->period / 2 : ORDER_NS;
}

static int64_t v4l_due(const struct camera *camera) {
    return order_due(&((const struct v4l_camera *)camera)->order, patience_for_order(camera));
}

/* The capture time, if the driver has it by CLOCK_MONOTONIC. */
static int64_t time_of(const struct v4l2_buffer *buffer) {
    bool monotonic = (buffer->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;

    return monotonic ? buffer->timestamp.tv_sec * SECOND + buffer->timestamp.tv_usec * 1000 : 0;
}

static bool next_in_order(struct v4l_camera *v4l, int64_t now, struct camera_frame *frame) {
    unsigned slot;

    if (!order_next(&v4l->order, now, patience_for_order(&v4l->camera), &slot))
        return false;
    const struct v4l2_buffer *buffer = &v4l->taken[slot];
    *frame = (struct camera_frame){.data = v4l->device.buffer[slot].data,
                                   .size = buffer->bytesused,
                                   .time = time_of(buffer),
                                   .damaged = (buffer->flags & V4L2_BUF_FLAG_ERROR) != 0,
                                   .sequence = buffer->sequence,
                                   .slot = slot};
    return true;
}

static int v4l_take(struct camera *camera, int64_t now, struct camera_frame *frame) {
    struct v4l_camera *v4l = v4l_of(camera);
    struct v4l2_buffer buffer;
    int error = 0;

    while (!error && !next_in_order(v4l, now, frame)) {
        error = now < INT64_MAX ? device_take(&v4l->device, &buffer) : -EAGAIN;
        if (error)
            break;
        v4l->taken[buffer.index] = buffer;
        if (!order_add(&v4l->order, buffer.sequence, buffer.index, now))
            error = device_give(&v4l->device, &buffer);
    }
    return error;
}

static int v4l_give(struct camera *camera, const struct camera_frame *frame) {
    struct v4l_camera *v4l = v4l_of(camera);

    return device_give(&v4l->device, &v4l->taken[frame->slot]);
}

static enum camera_event v4l_events(struct camera *camera, struct controls *controls) {
    enum camera_event found = CAMERA_NOTHING;
    struct v4l2_event event;

    while (!device_ioctl(camera->fd, VIDIOC_DQEVENT, &event)) {
        if (event.type == V4L2_EVENT_SOURCE_CHANGE)
            return CAMERA_OTHER_SIGNAL;
        v4l_controls_follow(controls, camera->fd, event.id);
        found = CAMERA_CONTROLS_CHANGED;
    }
    return found;
}

static void v4l_list(struct camera *camera, struct controls *controls) {
    v4l_controls_list(controls, camera->fd);
}

static void v4l_refresh(struct camera *camera, struct controls *controls) {
    for (int i = 0; i < controls->list.count; i++)
        v4l_controls_follow(controls, camera->fd, controls->id[i]);
}

static int v4l_set(struct camera *camera, uint32_t id, int value) {
    return v4l_controls_set(camera->fd, id, value);
}

void v4l_camera_init(struct v4l_camera *v4l) {
    static const struct camera_functions functions = {.open = v4l_open,
                                                      .close = v4l_close,
                                                      .take = v4l_take,
                                                      .give = v4l_give,
                                                      .due = v4l_due,
                                                      .events = v4l_events,
                                                      .list = v4l_list,
                                                      .refresh = v4l_refresh,
                                                      .set = v4l_set};

    *v4l = (struct v4l_camera){.camera = {.call = &functions, .name = v4l->wish.path, .fd = -1}, .device = {.fd = -1}};
}
