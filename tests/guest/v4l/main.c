/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>

#include "v4l.h"

static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
} jobs[] = {{"control", control}, {"feed", feed}, {"hold", hold}, {"iidc", iidc}, {"uvc", uvc}};

void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "v4l: ");
    vfprintf(stderr, format, arguments);
    fprintf(stderr, ": %s\n", strerror(errno));
    va_end(arguments);
    exit(1);
}

int open_device(const char *path) {
    int fd = open(path, O_RDWR);
    if (fd < 0)
        fail("%s", path);
    return fd;
}

void call(int fd, unsigned long request, void *argument, const char *what) {
    while (ioctl(fd, request, argument) < 0)
        if (errno != EINTR)
            fail("%s", what);
}

void *map(int fd, const struct v4l2_buffer *buffer) {
    void *data = mmap(NULL, buffer->length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, buffer->m.offset);
    if (data == MAP_FAILED)
        fail("mmap");
    return data;
}

void sleep_ms(long ms) {
    struct timespec time = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&time, NULL);
}

int64_t now_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

void file_read(struct clip *clip, const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END))
        fail("%s", path);
    clip->size = (size_t)ftell(file);
    clip->data = malloc(clip->size + 1);
    rewind(file);
    if (!clip->data || fread(clip->data, 1, clip->size, file) != clip->size)
        fail("%s", path);
    fclose(file);
    clip->data[clip->size] = 0;
}

void clip_read(struct clip *clip, const char *path) {
    file_read(clip, path);
    if (sscanf((char *)clip->data, "YUV4MPEG2 W%u H%u", &clip->width, &clip->height) != 2)
        fail("%s: no clip", path);
    clip->frame_size = (size_t)clip->width * clip->height * 3 / 2;
    clip->frames = (unsigned)(clip->size / clip->frame_size);
}

/* Lines of frames are "FRAME\n" in the clips that the tests make. */
const unsigned char *clip_frame(const struct clip *clip, unsigned number) {
    const unsigned char *first = memchr(clip->data, '\n', clip->size);
    const unsigned char *frame = first + 1 + (clip->frame_size + 6) * (size_t)number;
    if (memcmp(frame, "FRAME\n", 6) != 0)
        fail("frame %u", number);
    return frame + 6;
}

int main(int argc, char **argv) {
    for (unsigned i = 0; argc > 1 && i < sizeof(jobs) / sizeof(*jobs); i++)
        if (!strcmp(argv[1], jobs[i].name))
            return jobs[i].run(argc - 1, argv + 1);
    fprintf(stderr, "usage: v4l control|feed|hold|iidc|uvc ...\n");
    return 2;
}
