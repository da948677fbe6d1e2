/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: a slow card. Each pwrite() takes 50 ms at least. The file $PACED_LOG gets a line for each one, with its
 * bytes and the ns that it took, and for each nanosleep(), with the ns that it was asked for.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

enum { SLOW = 50000000 }; /* ns */

static long long now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * 1000000000LL + time.tv_nsec;
}

static void note(const char *what, long long number, long long more) {
    const int fd = open(getenv("PACED_LOG"), O_WRONLY | O_CREAT | O_APPEND, 0644);
    dprintf(fd, "%s %lld %lld\n", what, number, more);
    close(fd);
}

ssize_t pwrite64(int fd, const void *bytes, size_t size, off64_t offset) {
    const long long begin = now();
    clock_nanosleep(CLOCK_MONOTONIC, 0, &(struct timespec){.tv_nsec = SLOW}, NULL);
    const ssize_t done = syscall(SYS_pwrite64, fd, bytes, size, offset);
    note("write", done, now() - begin);
    return done;
}

int nanosleep(const struct timespec *time, struct timespec *left) {
    note("sleep", time->tv_sec * 1000000000LL + time->tv_nsec, 0);
    (void)left;
    return clock_nanosleep(CLOCK_MONOTONIC, 0, time, NULL);
}
