/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "v4l_controls.h"

#include "device.h"

/* Whether its value is a number that fits a parameter. */
static bool is_number(const struct v4l2_queryctrl *query) {
    switch (query->type) {
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_BOOLEAN:
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
    case V4L2_CTRL_TYPE_BITMASK:
    case V4L2_CTRL_TYPE_BUTTON: return !(query->flags & V4L2_CTRL_FLAG_DISABLED);
    default: return false;
    }
}

/* Reads range, flags and value. */
static void describe(struct controls *controls, int i, int fd, const struct v4l2_queryctrl *query) {
    bool button = query->type == V4L2_CTRL_TYPE_BUTTON;
    struct v4l2_control now = {.id = query->id};

    controls->kind[i] = button                                   ? CONTROL_BUTTON
                        : query->type == V4L2_CTRL_TYPE_BITMASK ? CONTROL_BITS
                                                                 : CONTROL_NUMBER;
    controls->list.parameter[i].minimum = button ? 0 : query->minimum;
    controls->list.parameter[i].maximum = button ? 1 : query->maximum;
    controls->list.parameter[i].step = query->step > 0 ? query->step : 1;
    controls->list.parameter[i].initial = button ? 0 : query->default_value;
    controls->list.parameter[i].flags =
        (query->flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_GRABBED) ? DDX_VIDEO_PARAMETER_READ_ONLY : 0) |
        (query->flags & V4L2_CTRL_FLAG_INACTIVE ? DDX_VIDEO_PARAMETER_AUTOMATIC : 0);
    if (!button && !(query->flags & V4L2_CTRL_FLAG_WRITE_ONLY) && !device_ioctl(fd, VIDIOC_G_CTRL, &now))
        controls->list.parameter[i].value = now.value;
}

static void add(struct controls *controls, int fd, const struct v4l2_queryctrl *query) {
    struct v4l2_event_subscription follow = {.type = V4L2_EVENT_CTRL, .id = query->id};
    int i = is_number(query) ? controls_add(controls, query->id, (const char *)query->name) : -1;

    if (i < 0)
        return;
    describe(controls, i, fd, query);
    device_ioctl(fd, VIDIOC_SUBSCRIBE_EVENT, &follow);
}

void v4l_controls_list(struct controls *controls, int fd) {
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};

    for (; !device_ioctl(fd, VIDIOC_QUERYCTRL, &query); query.id |= V4L2_CTRL_FLAG_NEXT_CTRL)
        add(controls, fd, &query);
}

void v4l_controls_follow(struct controls *controls, int fd, uint32_t id) {
    struct v4l2_queryctrl query = {.id = id};
    int i = controls_find(controls, id);

    if (i >= 0 && !device_ioctl(fd, VIDIOC_QUERYCTRL, &query))
        describe(controls, i, fd, &query);
}

int v4l_controls_set(int fd, uint32_t id, int value) {
    struct v4l2_control control = {.id = id, .value = value};

    return device_ioctl(fd, VIDIOC_S_CTRL, &control);
}
