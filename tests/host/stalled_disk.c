/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: a disk that stands still for as long as a test wants. While the file $STALLED_SYNC exists fdatasync() and
 * syncfs() do not return, and while $STALLED_OPEN does, the first open() of a recording does not; later ones do. While
 * $FAILED_SYNC exists, fdatasync() fails. With $LOCKED_FIRST the first file that is locked is locked already.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <unistd.h>

static void stall(const char *name) {
    const char *file = getenv(name);
    while (file && !access(file, F_OK))
        usleep(1000);
}

int fdatasync(int fd) {
    stall("STALLED_SYNC");
    const char *failed = getenv("FAILED_SYNC");
    if (failed && !access(failed, F_OK)) {
        errno = EIO;
        return -1;
    }
    return (int)syscall(SYS_fdatasync, fd);
}

int syncfs(int fd) {
    stall("STALLED_SYNC");
    return (int)syscall(SYS_syncfs, fd);
}

int flock(int fd, int operation) {
    static atomic_int locked;
    if (getenv("LOCKED_FIRST") && !locked++) {
        errno = EWOULDBLOCK;
        return -1;
    }
    return (int)syscall(SYS_flock, fd, operation);
}

int open(const char *path, int flags, ...) {
    static atomic_int opened;
    va_list rest;
    va_start(rest, flags);
    const mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    if (flags & O_CREAT && strstr(path, ".y4m") && !opened++)
        stall("STALLED_OPEN");
    return (int)syscall(SYS_openat, AT_FDCWD, path, flags, mode);
}

/* What open() is called with 64-bit offsets. */
int open64(const char *path, int flags, ...) __attribute__((alias("open")));
