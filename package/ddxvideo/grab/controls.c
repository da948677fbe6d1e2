/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "controls.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "device.h"

void controls_name(char to[32], const char *from) {
    unsigned length = 0;

    for (; *from && length < 31; from++) {
        if (isalnum((unsigned char)*from))
            to[length++] = (char)tolower((unsigned char)*from);
        else if (length && to[length - 1] != '_')
            to[length++] = '_';
    }
    while (length && to[length - 1] == '_')
        length--;
    to[length] = 0;
}

static int find_name(const struct controls *controls, const char *name) {
    for (int i = 0; i < controls->list.count; i++)
        if (!strcmp(controls->list.parameter[i].name, name))
            return i;
    return -1;
}

static int find_id(const struct controls *controls, uint32_t id) {
    for (int i = 0; i < controls->list.count; i++)
        if (controls->id[i] == id)
            return i;
    return -1;
}

/* Those whose value is a number that fits a parameter. */
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

/* Range, flags and value, as they are now. */
static void describe(struct controls *controls, int i, int fd, const struct v4l2_queryctrl *query) {
    bool button = query->type == V4L2_CTRL_TYPE_BUTTON;
    struct v4l2_control now = {.id = query->id};

    controls->id[i] = query->id;
    controls->type[i] = query->type;
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
    char name[32], wanted[32];
    int i = controls->list.count;

    if (i == DDX_VIDEO_PARAMETERS_MAX || !is_number(query))
        return;
    controls_name(wanted, (const char *)query->name);
    strcpy(name, wanted);
    for (unsigned twin = 2; find_name(controls, name) >= 0; twin++)
        snprintf(name, sizeof name, "%.27s_%u", wanted, twin % 100);
    strcpy(controls->list.parameter[i].name, name);
    controls->list.count++;
    describe(controls, i, fd, query);
    device_ioctl(fd, VIDIOC_SUBSCRIBE_EVENT, &follow);
}

void controls_begin(struct controls *controls, int fd) {
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};

    for (unsigned i = 0; i < controls->asked_count; i++) {
        struct v4l2_control again = {.id = controls->asked[i].id, .value = controls->asked[i].value};

        device_ioctl(fd, VIDIOC_S_CTRL, &again); /* another camera may not have it */
    }
    memset(&controls->list, 0, sizeof controls->list);
    for (; !device_ioctl(fd, VIDIOC_QUERYCTRL, &query); query.id |= V4L2_CTRL_FLAG_NEXT_CTRL)
        add(controls, fd, &query);
}

void controls_follow(struct controls *controls, int fd, uint32_t id) {
    struct v4l2_queryctrl query = {.id = id};
    int i = find_id(controls, id);

    if (i >= 0 && !device_ioctl(fd, VIDIOC_QUERYCTRL, &query))
        describe(controls, i, fd, &query);
}

/* Of a bit mask any bits of its maximum may be set; of others the driver would take the nearest step. */
static bool fits(const struct controls *controls, int i, int64_t value) {
    int64_t minimum = controls->list.parameter[i].minimum, maximum = controls->list.parameter[i].maximum;

    if (controls->type[i] == V4L2_CTRL_TYPE_BITMASK)
        return !(value & ~(int64_t)(uint32_t)maximum);
    return value >= minimum && value <= maximum && (value - minimum) % controls->list.parameter[i].step == 0;
}

static void tell_range(const struct controls *controls, int i, int64_t value, char text[DDX_ANSWER_TEXT]) {
    const char *name = controls->list.parameter[i].name;
    int minimum = controls->list.parameter[i].minimum, maximum = controls->list.parameter[i].maximum;
    char steps[32] = "";

    if (controls->list.parameter[i].step > 1)
        snprintf(steps, sizeof steps, " in steps of %d", controls->list.parameter[i].step);
    if (controls->type[i] == V4L2_CTRL_TYPE_BITMASK)
        snprintf(text, DDX_ANSWER_TEXT, "%s: takes the bits of %#x, not %" PRId64, name, (unsigned)maximum, value);
    else
        snprintf(text, DDX_ANSWER_TEXT, "%s: takes a whole number from %d to %d%s, not %" PRId64, name, minimum,
                 maximum, steps, value);
}

int controls_check(const struct controls *controls, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]) {
    for (unsigned k = 0; k < request->count; k++) {
        const char *name = request->change[k].name;
        int i = find_name(controls, name);

        if (i < 0) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: no such parameter", name);
            return -EINVAL;
        }
        if (controls->list.parameter[i].flags & DDX_VIDEO_PARAMETER_READ_ONLY) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: cannot be changed now", name);
            return -EACCES;
        }
        if (!fits(controls, i, request->change[k].value)) {
            tell_range(controls, i, request->change[k].value, text);
            return -ERANGE;
        }
    }
    return 0;
}

static void remember(struct controls *controls, uint32_t id, int value) {
    unsigned i = 0;

    while (i < controls->asked_count && controls->asked[i].id != id)
        i++;
    if (i == DDX_VIDEO_PARAMETERS_MAX)
        return;
    controls->asked[i].id = id;
    controls->asked[i].value = value;
    if (i == controls->asked_count)
        controls->asked_count++;
}

/* Back to what they were, the last one first. */
static void undo(const struct controls *controls, int fd, const DDX_REQUEST *request, unsigned made) {
    while (made-- > 0) {
        int i = find_name(controls, request->change[made].name);
        struct v4l2_control former = {.id = controls->id[i], .value = controls->list.parameter[i].value};

        if (controls->type[i] != V4L2_CTRL_TYPE_BUTTON)
            device_ioctl(fd, VIDIOC_S_CTRL, &former);
    }
}

int controls_change(struct controls *controls, int fd, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]) {
    int error = controls_check(controls, request, text);

    for (unsigned k = 0; !error && k < request->count; k++) {
        int i = find_name(controls, request->change[k].name);
        struct v4l2_control control = {.id = controls->id[i], .value = (int)request->change[k].value};

        error = device_ioctl(fd, VIDIOC_S_CTRL, &control);
        if (error) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: the camera refuses: %s", request->change[k].name, strerror(-error));
            undo(controls, fd, request, k);
        }
    }
    if (error)
        return error;
    for (unsigned k = 0; k < request->count; k++) {
        int i = find_name(controls, request->change[k].name);

        if (controls->type[i] != V4L2_CTRL_TYPE_BUTTON)
            remember(controls, controls->id[i], (int)request->change[k].value);
    }
    for (int i = 0; i < controls->list.count; i++) /* one may change others, such as its automatic twin */
        controls_follow(controls, fd, controls->id[i]);
    return 0;
}
