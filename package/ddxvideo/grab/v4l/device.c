/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "device.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/ioctl.h>

int device_ioctl(int fd, unsigned long request, void *argument) {
    int result;

    do
        result = ioctl(fd, request, argument);
    while (result < 0 && errno == EINTR);
    return result < 0 ? -errno : 0;
}

/* ---- The socket of a frame grabber, and the television standard ---- */

static const struct {
    const char *name;
    v4l2_std_id standard;
} standards[] = {{"PAL", V4L2_STD_PAL}, {"NTSC", V4L2_STD_NTSC}, {"SECAM", V4L2_STD_SECAM}};

bool input_parse_standard(const char *text, v4l2_std_id *standard) {
    for (unsigned i = 0; i < sizeof standards / sizeof *standards; i++) {
        if (!strcasecmp(text, standards[i].name)) {
            *standard = standards[i].standard;
            return true;
        }
    }
    return false;
}

bool input_is_meant(const struct v4l2_input *input, const char *text) {
    char *end;
    unsigned long number = strtoul(text, &end, 10);

    if (isdigit((unsigned char)*text) && !*end)
        return number == input->index;
    return !strncasecmp((const char *)input->name, text, strlen(text));
}

static int select_input(int fd, const char *text, char *why, size_t size) {
    struct v4l2_input input = {.index = 0};

    for (; !device_ioctl(fd, VIDIOC_ENUMINPUT, &input); input.index++) {
        if (!input_is_meant(&input, text))
            continue;
        int index = (int)input.index, error = device_ioctl(fd, VIDIOC_S_INPUT, &index);
        if (error)
            snprintf(why, size, "input %s: %s", input.name, strerror(-error));
        return error;
    }
    char names[128] = "";
    for (input.index = 0; !device_ioctl(fd, VIDIOC_ENUMINPUT, &input); input.index++)
        snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", input.index ? ", " : "", input.name);
    snprintf(why, size, "no input %s; there are: %s", text, *names ? names : "none");
    return -EINVAL;
}

static int select_standard(int fd, v4l2_std_id standard, char *why, size_t size) {
    int error = device_ioctl(fd, VIDIOC_S_STD, &standard);

    if (error == -ENOTTY || error == -ENODATA) {
        snprintf(why, size, "this input has no television standard");
        return -EINVAL;
    }
    if (error)
        snprintf(why, size, "television standard: %s", strerror(-error));
    return error;
}

int input_select(int fd, const char *input, const char *standard, char *why, size_t size) {
    v4l2_std_id wanted, found, present;
    int error = input ? select_input(fd, input, why, size) : 0;
    if (error)
        return error;
    if (standard)
        return input_parse_standard(standard, &wanted) ? select_standard(fd, wanted, why, size) : -EINVAL;
    struct v4l2_dv_timings timings = {.type = 0};
    if (!device_ioctl(fd, VIDIOC_QUERY_DV_TIMINGS, &timings))
        device_ioctl(fd, VIDIOC_S_DV_TIMINGS, &timings);
    /* The signal decides if its standard differs from the one that is set. */
    if (device_ioctl(fd, VIDIOC_G_STD, &present) || device_ioctl(fd, VIDIOC_QUERYSTD, &found))
        return 0;
    if (found && !(found & present))
        return select_standard(fd, found, why, size);
    return 0;
}
