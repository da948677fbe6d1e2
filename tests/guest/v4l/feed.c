/* SPDX-License-Identifier: GPL-2.0-or-later */
/* v4l feed DEVICE OUTPUT FOURCC FIELD MS CLIP FOLDER
 *
 * Shows a 4:2:0 clip as YU12, NV12, YUYV, UYVY or GREY on an output device, a frame each MS milliseconds:
 * the first one until FOLDER/go exists, the last one until FOLDER/end exists. Writes to FOLDER/times when each
 * frame came on the screen, in ms of CLOCK_MONOTONIC, by the driver; for the first one, when FOLDER/go
 * appeared. A busy guest is late at times. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "v4l.h"

#define BUFFERS 4

static void wait_for_file(const char *folder, const char *name) {
    char path[256];
    snprintf(path, sizeof(path), "%s/%s", folder, name);
    while (access(path, F_OK))
        sleep_ms(20);
}

static unsigned char *put_row(unsigned char *to, const char *fourcc, const struct clip *clip, const unsigned char *y,
                              unsigned row) {
    /* In interlaced 4:2:0, rows of chroma alternate between the fields like those of luma. */
    unsigned chroma = row / 4 * 2 + row % 2, half = clip->width / 2;
    const unsigned char *u = y + clip->width * clip->height + chroma * half, *v = u + half * clip->height / 2;
    bool luma_first = *fourcc == 'Y';
    y += row * clip->width;
    for (unsigned x = 0; x < half; x++) {
        const unsigned char four[] = {y[2 * x], u[x], y[2 * x + 1], v[x]};
        for (unsigned i = 0; i < 4; i++)
            *to++ = four[luma_first ? i : i ^ 1];
    }
    return to;
}

/* Converts a frame to the device's layout; returns its size. */
static size_t pack(unsigned char *to, const char *fourcc, const struct clip *clip, const unsigned char *frame) {
    size_t luma = (size_t)clip->width * clip->height;
    if (!strcmp(fourcc, "YUYV") || !strcmp(fourcc, "UYVY")) {
        for (unsigned row = 0; row < clip->height; row++)
            to = put_row(to, fourcc, clip, frame, row);
        return 2 * luma;
    }
    memcpy(to, frame, *fourcc == 'G' ? luma : clip->frame_size);
    for (size_t i = 0; *fourcc == 'N' && i < luma / 4; i++) {
        to[luma + 2 * i] = frame[luma + i];
        to[luma + 2 * i + 1] = frame[luma / 4 * 5 + i];
    }
    return *fourcc == 'G' ? luma : clip->frame_size;
}

static void setup(int fd, int output, const char *fourcc, unsigned field, const struct clip *clip) {
    struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
    call(fd, VIDIOC_S_OUTPUT, &output, "output");
    format.fmt.pix.width = clip->width;
    format.fmt.pix.height = clip->height;
    format.fmt.pix.pixelformat = v4l2_fourcc(fourcc[0], fourcc[1], fourcc[2], fourcc[3]);
    format.fmt.pix.field = field;
    call(fd, VIDIOC_S_FMT, &format, "format");
    if (format.fmt.pix.width != clip->width || format.fmt.pix.height != clip->height || format.fmt.pix.field != field)
        fail("the driver wants %ux%u, field %u", format.fmt.pix.width, format.fmt.pix.height, format.fmt.pix.field);
}

/* The clip's frame in the n-th queued buffer; the first buffers all hold the first frame. */
static unsigned frame_in(unsigned queued) {
    return queued < BUFFERS ? 0 : queued - BUFFERS + 1;
}

/* Takes the next buffer that the driver is done with; at that time the following one came on the screen. */
static void take_back(int fd, struct v4l2_buffer *buffer, int64_t *since) {
    static unsigned taken;
    call(fd, VIDIOC_DQBUF, buffer, "take a buffer");
    since[frame_in(++taken)] = (int64_t)buffer->timestamp.tv_sec * 1000 + buffer->timestamp.tv_usec / 1000;
}

int feed(int argc, char **argv) {
    struct clip clip;
    void *memory[BUFFERS];
    int type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    if (argc != 8)
        fail("usage");
    int fd = open_device(argv[1]);
    unsigned field = (unsigned)atoi(argv[4]);
    clip_read(&clip, argv[6]);
    setup(fd, atoi(argv[2]), argv[3], field, &clip);
    struct v4l2_requestbuffers request = {
        .count = BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_OUTPUT, .memory = V4L2_MEMORY_MMAP};
    call(fd, VIDIOC_REQBUFS, &request, "buffers");
    for (unsigned i = 0; i < BUFFERS; i++) {
        struct v4l2_buffer buffer = {.index = i, .type = request.type, .memory = request.memory};
        call(fd, VIDIOC_QUERYBUF, &buffer, "buffer");
        memory[i] = map(fd, &buffer);
    }
    char path[256];
    snprintf(path, sizeof(path), "%s/times", argv[7]);
    FILE *times = fopen(path, "w");
    if (!times)
        fail("cannot write %s", path);
    int64_t go = 0, due = 0, *since = calloc(clip.frames, sizeof(*since));
    if (!since)
        fail("memory");
    for (unsigned shown = 0; shown < clip.frames + BUFFERS - 1; shown++) {
        struct v4l2_buffer buffer = {.index = shown, .type = request.type, .memory = request.memory};
        if (shown >= BUFFERS)
            take_back(fd, &buffer, since);
        size_t size = pack(memory[buffer.index], argv[3], &clip, clip_frame(&clip, frame_in(shown)));
        buffer.field = field;
        buffer.bytesused = (unsigned)size;
        call(fd, VIDIOC_QBUF, &buffer, "show a frame");
        if (shown < BUFFERS - 1)
            continue;
        if (shown == BUFFERS - 1) {
            call(fd, VIDIOC_STREAMON, &type, "start");
            wait_for_file(argv[7], "go");
            go = due = now_ms();
        }
        due += atol(argv[5]);
        if (due > now_ms())
            sleep_ms(due - now_ms());
    }
    for (unsigned i = 1; i < BUFFERS; i++) { /* the last frame waits for those before it */
        struct v4l2_buffer buffer = {.type = request.type, .memory = request.memory};
        take_back(fd, &buffer, since);
    }
    since[0] = go;
    for (unsigned number = 0; number < clip.frames; number++)
        fprintf(times, "%lld\n", (long long)since[number]);
    sleep_ms(500); /* so that a camera captures it */
    fclose(times);
    printf("shown %u\n", clip.frames);
    fflush(stdout);
    wait_for_file(argv[7], "end");
    return 0;
}
