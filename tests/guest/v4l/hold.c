/* SPDX-License-Identifier: GPL-2.0-or-later */
/* v4l hold DEVICE MS: streams without reading the frames. */
#include <stdlib.h>

#include "v4l.h"

int hold(int argc, char **argv) {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    struct v4l2_requestbuffers request = {.count = 2, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    if (argc != 3)
        fail("usage");
    int fd = open_device(argv[1]);
    call(fd, VIDIOC_REQBUFS, &request, "buffers");
    call(fd, VIDIOC_STREAMON, &type, "start");
    printf("holds\n");
    fflush(stdout);
    sleep_ms(atol(argv[2]));
    return 0;
}
