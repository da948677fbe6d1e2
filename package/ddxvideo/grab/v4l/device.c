/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "device.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

int device_ioctl(int fd, unsigned long request, void *argument) {
    int result;

    do
        result = ioctl(fd, request, argument);
    while (result < 0 && errno == EINTR);
    return result < 0 ? -errno : 0;
}

void device_close(struct device *device) {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;

    if (device->fd < 0)
        return;
    if (device->streaming)
        device_ioctl(device->fd, VIDIOC_STREAMOFF, &type);
    for (unsigned i = 0; i < device->buffers; i++)
        if (device->buffer[i].data)
            munmap(device->buffer[i].data, device->buffer[i].size);
    close(device->fd);
    memset(device, 0, sizeof *device);
    device->fd = -1;
}

int device_take(struct device *device, struct v4l2_buffer *buffer) {
    *buffer = (struct v4l2_buffer){.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    int error = device_ioctl(device->fd, VIDIOC_DQBUF, buffer);
    if (error)
        return error;
    if (buffer->index >= device->buffers)
        return -EIO;
    if (buffer->bytesused > device->buffer[buffer->index].size)
        buffer->bytesused = (uint32_t)device->buffer[buffer->index].size;
    return 0;
}

int device_give(struct device *device, struct v4l2_buffer *buffer) {
    struct v4l2_buffer again = {
        .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = buffer->index};
    int error = device_ioctl(device->fd, VIDIOC_QBUF, &again);

    return error == -EINVAL ? device_ioctl(device->fd, VIDIOC_QBUF, &again) : error; /* may be temporary */
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
