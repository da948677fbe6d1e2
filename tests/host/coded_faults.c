/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded into a recorder of MP4 files. $KILLED_AT: the recorder is killed before this pwrite() or fdatasync() of a
 * file's end, counted from 0 at the first pwrite(), which writes the table; with $KILLED_HALF after half of that write.
 * $FAILING_AT: the encoding of this frame, counted from 0, and of the next one fails.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/types.h>
#include <unistd.h>

static int calls;

static int is_next(void) {
    const char *wanted = getenv("KILLED_AT");

    return wanted && calls++ == atoi(wanted);
}

ssize_t pwrite64(int fd, const void *from, size_t size, off64_t at) {
    static ssize_t (*next)(int fd, const void *from, size_t size, off64_t at);

    *(void **)&next = dlsym(RTLD_NEXT, "pwrite64");
    if (is_next()) {
        if (getenv("KILLED_HALF"))
            next(fd, from, size / 2, at);
        kill(getpid(), SIGKILL);
    }
    return next(fd, from, size, at);
}

int fdatasync(int fd) {
    static int (*next)(int fd);

    *(void **)&next = dlsym(RTLD_NEXT, "fdatasync");
    if (calls && is_next())
        kill(getpid(), SIGKILL);
    return next(fd);
}

int x264_encoder_encode(void *encoder, void *nal, int *count, void *in, void *out) {
    static int (*next)(void *encoder, void *nal, int *count, void *in, void *out);
    static int frames;
    const char *failing = getenv("FAILING_AT");

    *(void **)&next = dlsym(RTLD_NEXT, "x264_encoder_encode");
    int frame = frames++;
    if (failing && (frame == atoi(failing) || frame == atoi(failing) + 1))
        return -1;
    return next(encoder, nal, count, in, out);
}
