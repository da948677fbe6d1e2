/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "device.h"

#include <errno.h>
#include <string.h>
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
