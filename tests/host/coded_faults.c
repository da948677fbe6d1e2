/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded into a recorder of MP4 files. $KILLED_AT: the recorder is killed before this call of the end of a file that
 * writes, flushes, cuts or names, counted from 0, which writes the table; with $KILLED_HALF after half of that write.
 * $SLOW_MS: an encoder that takes so long for a frame, and a third of that as soon as its crf is 26 or more.
 * $TRACE: the file that gets a line for each of these calls.
 * $FAILING_AT: the encoding of this frame, counted from 0, and of the next one fails.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>
#include <x264.h>

static _Thread_local int ends; /* this thread has begun a table */
static int calls;

static void trace(const char *what, int fd, long at) {
    char link[32], path[PATH_MAX] = "", line[64];
    const char *file = getenv("TRACE");

    if (!file)
        return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    if (readlink(link, path, sizeof path - 1) < 0)
        return;
    const char *name = strrchr(path, '/'), *end = strrchr(path, '.');
    int length = snprintf(line, sizeof line, at < 0 ? "%s %.30s\n" : "%s %.30s %ld\n", what,
                          name && end > name ? end : name, at);
    int to = (int)syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND, 0644);
    (void)!write(to, line, (size_t)length);
    close(to);
}

static int is_next(const char *what, int fd, long at) {
    const char *wanted = getenv("KILLED_AT");

    if (!ends)
        return 0;
    trace(what, fd, at);
    return wanted && calls++ == atoi(wanted);
}

static void may_die(const char *what, int fd) {
    if (is_next(what, fd, -1))
        kill(getpid(), SIGKILL);
}

ssize_t pwrite64(int fd, const void *from, size_t size, off64_t at) {
    ends |= size > 8 && !memcmp((const char *)from + 4, "moov", 4);
    if (is_next("write", fd, at < 4096 ? (long)at : -1)) {
        if (getenv("KILLED_HALF"))
            (void)!syscall(SYS_pwrite64, fd, from, size / 2, at);
        kill(getpid(), SIGKILL);
    }
    return (ssize_t)syscall(SYS_pwrite64, fd, from, size, at);
}

int fdatasync(int fd) {
    may_die("flush", fd);
    return (int)syscall(SYS_fdatasync, fd);
}

int syncfs(int fd) {
    may_die("flush", fd);
    return (int)syscall(SYS_syncfs, fd);
}

int fsync(int fd) {
    may_die("flush", fd);
    return (int)syscall(SYS_fsync, fd);
}

int ftruncate64(int fd, off64_t size) {
    may_die("cut", fd);
    return (int)syscall(SYS_ftruncate, fd, size);
}

int linkat(int from, const char *old, int to, const char *name, int flags) {
    may_die("name", to);
    return (int)syscall(SYS_linkat, from, old, to, name, flags);
}

static atomic_int coarse;

int x264_encoder_reconfig(x264_t *encoder, x264_param_t *param) {
    static int (*next)(x264_t * encoder, x264_param_t * param);

    *(void **)&next = dlsym(RTLD_NEXT, "x264_encoder_reconfig");
    coarse = param->rc.f_rf_constant >= 26;
    return next(encoder, param);
}

int x264_encoder_encode(x264_t *encoder, x264_nal_t **nal, int *count, x264_picture_t *in, x264_picture_t *out) {
    static int (*next)(x264_t * encoder, x264_nal_t * *nal, int *count, x264_picture_t *in, x264_picture_t *out);
    static int frames;
    const char *failing = getenv("FAILING_AT"), *slow = getenv("SLOW_MS");

    *(void **)&next = dlsym(RTLD_NEXT, "x264_encoder_encode");
    int frame = frames++;
    if (failing && (frame == atoi(failing) || frame == atoi(failing) + 1))
        return -1;
    if (slow)
        usleep((useconds_t)(1000 * atoi(slow) / (coarse ? 3 : 1)));
    return next(encoder, nal, count, in, out);
}
