/* SPDX-License-Identifier: GPL-2.0-or-later */
/* v4l control DEVICE              lists all controls: name=value
 * v4l control DEVICE NAME=VALUE   sets one; a menu's value may be the beginning of an entry's text */
#include <stdlib.h>
#include <string.h>

#include "v4l.h"
#include <sys/ioctl.h>

static int menu_index(int fd, const struct v4l2_queryctrl *query, const char *text) {
    for (int i = query->minimum; i <= query->maximum; i++) {
        struct v4l2_querymenu entry = {.id = query->id, .index = (unsigned)i};
        if (!ioctl(fd, VIDIOC_QUERYMENU, &entry) && !strncmp((char *)entry.name, text, strlen(text)))
            return i;
    }
    fail("no entry %s", text);
}

static void set(int fd, const struct v4l2_queryctrl *query, const char *text) {
    char *end;
    struct v4l2_control control = {.id = query->id, .value = (int)strtol(text, &end, 0)};
    if (query->type == V4L2_CTRL_TYPE_MENU && *end)
        control.value = menu_index(fd, query, text);
    call(fd, VIDIOC_S_CTRL, &control, (const char *)query->name);
}

int control(int argc, char **argv) {
    int fd = open_device(argc > 1 ? argv[1] : "");
    const char *equals = argc > 2 ? strchr(argv[2], '=') : NULL;
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    for (; !ioctl(fd, VIDIOC_QUERYCTRL, &query); query.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
        size_t length = strlen((char *)query.name);
        struct v4l2_control value = {.id = query.id};
        if (!equals && !ioctl(fd, VIDIOC_G_CTRL, &value))
            printf("%s=%d\n", query.name, value.value);
        if (equals && (size_t)(equals - argv[2]) == length && !memcmp(argv[2], query.name, length)) {
            set(fd, &query, equals + 1);
            return 0;
        }
    }
    if (equals)
        fail("%s", argv[2]);
    return 0;
}
