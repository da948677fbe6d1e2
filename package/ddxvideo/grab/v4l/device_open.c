/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "device_open.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "negotiate.h"

#define LARGE_PICTURE (1 << 20) /* bytes; larger pictures get fewer buffers */
#define FEW_BUFFERS 5

/* Requests an event when another signal comes in. */
static void listen_to_source(int fd) {
    struct v4l2_event_subscription source = {.type = V4L2_EVENT_SOURCE_CHANGE};
    int input = 0;

    if (!device_ioctl(fd, VIDIOC_G_INPUT, &input))
        source.id = (unsigned)input;
    device_ioctl(fd, VIDIOC_SUBSCRIBE_EVENT, &source);
}

static int check_abilities(struct device *device, char *why, size_t size) {
    struct v4l2_capability able;
    int error = device_ioctl(device->fd, VIDIOC_QUERYCAP, &able);

    if (error == -ENOTTY || error == -EINVAL) {
        snprintf(why, size, "no video device");
        return -EINVAL;
    }
    if (error) {
        snprintf(why, size, "%s", strerror(-error));
        return error;
    }
    snprintf(device->card, sizeof device->card, "%.32s", (const char *)able.card);
    if (!(able.device_caps & V4L2_CAP_VIDEO_CAPTURE) || !(able.device_caps & V4L2_CAP_STREAMING)) {
        snprintf(why, size, "%s gives no pictures here; another device of it may", device->card);
        return -EINVAL;
    }
    return 0;
}

static int map_buffers(struct device *device) {
    for (unsigned i = 0; i < device->buffers; i++) {
        struct v4l2_buffer buffer = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = i};
        int error = device_ioctl(device->fd, VIDIOC_QUERYBUF, &buffer);

        if (error)
            return error;
        void *data = mmap(NULL, buffer.length, PROT_READ, MAP_SHARED, device->fd, (off_t)buffer.m.offset);
        if (data == MAP_FAILED)
            return -errno;
        device->buffer[i].data = data;
        device->buffer[i].size = buffer.length;
        error = device_ioctl(device->fd, VIDIOC_QBUF, &buffer);
        if (error)
            return error;
    }
    return 0;
}

static int start(struct device *device, char *why, size_t size) {
    bool large = device->geometry.width * device->geometry.height > LARGE_PICTURE;
    struct v4l2_requestbuffers request = {
        .count = large ? FEW_BUFFERS : DEVICE_BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    int error = device_ioctl(device->fd, VIDIOC_REQBUFS, &request);

    if (!error) {
        device->buffers = request.count < DEVICE_BUFFERS ? request.count : DEVICE_BUFFERS;
        error = map_buffers(device);
    }
    if (!error)
        error = device_ioctl(device->fd, VIDIOC_STREAMON, &type);
    if (error == -EBUSY)
        snprintf(why, size, "in use by another program");
    else if (error)
        snprintf(why, size, "does not start: %s", strerror(-error));
    device->streaming = !error;
    return error;
}

int device_open(struct device *device, const struct device_wish *wish, char *why, size_t size) {
    memset(device, 0, sizeof *device);
    device->fd = open(wish->path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (device->fd < 0) {
        int error = -errno;
        bool missing = error == -ENOENT || error == -ENODEV || error == -ENXIO;

        snprintf(why, size, "%s",
                 missing           ? "not there"
                 : error == -EBUSY ? "in use by another program"
                                   : strerror(-error));
        return error;
    }
    int error = check_abilities(device, why, size);
    if (!error)
        error = negotiate(device, wish, why, size);
    if (!error)
        error = start(device, why, size);
    if (error)
        device_close(device);
    else
        listen_to_source(device->fd);
    return error;
}
