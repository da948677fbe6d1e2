/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: a disk that stalls as long as a test wants. While the file $STALLED_SYNC exists, fdatasync() and syncfs()
 * do not return; likewise $STALLED_OPEN and the first open() of a recording, $STALLED_FSYNC and fsync(), $STALLED_WRITE
 * and pwrite(). While $FAILED_SYNC exists, fdatasync() fails. With $LOCKED_FIRST, the first lock is already taken.
 *
 * Linux reports a failed write once: if the file $FAILED_FLUSH exists, the next fdatasync() or syncfs() of a file whose
 * path ends with $FAILED_OF removes it and fails; with $FAILED_FSYNC, the next fsync(). $FLUSHED gets a byte for each
 * fdatasync() that succeeds.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

static void stall(const char *name) {
    const char *file = getenv(name);
    while (file && !access(file, F_OK))
        usleep(1000);
}

static int fails_once(const char *name, int fd) {
    const char *file = getenv(name), *end = getenv("FAILED_OF");
    char link[32], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t length = readlink(link, path, sizeof path);
    if (!file || !end || length < (ssize_t)strlen(end) || strncmp(path + length - strlen(end), end, strlen(end)) != 0 ||
        unlink(file))
        return 0;
    errno = EIO;
    return 1;
}

ssize_t pwrite64(int fd, const void *from, size_t size, off64_t at) {
    stall("STALLED_WRITE");
    return (ssize_t)syscall(SYS_pwrite64, fd, from, size, at);
}

int fsync(int fd) {
    stall("STALLED_FSYNC");
    return fails_once("FAILED_FSYNC", fd) ? -1 : (int)syscall(SYS_fsync, fd);
}

int syncfs(int fd) {
    stall("STALLED_SYNC");
    return fails_once("FAILED_FLUSH", fd) ? -1 : (int)syscall(SYS_syncfs, fd);
}

static void note_flush(void) {
    const char *file = getenv("FLUSHED");
    const int fd = file ? (int)syscall(SYS_openat, AT_FDCWD, file, O_WRONLY | O_CREAT | O_APPEND, 0644) : -1;
    if (fd < 0)
        return;
    (void)!write(fd, ".", 1);
    close(fd);
}

int fdatasync(int fd) {
    stall("STALLED_SYNC");
    const char *failed = getenv("FAILED_SYNC");
    if (failed && !access(failed, F_OK)) {
        errno = EIO;
        return -1;
    }
    if (fails_once("FAILED_FLUSH", fd))
        return -1;
    const int result = (int)syscall(SYS_fdatasync, fd);
    if (!result)
        note_flush();
    return result;
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

/* The name of open() with 64-bit offsets. */
int open64(const char *path, int flags, ...) __attribute__((alias("open")));
