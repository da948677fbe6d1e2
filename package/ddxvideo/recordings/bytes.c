/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bytes.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define PIECE (1u << 20)
#define BLOCK 4096u

static volatile sig_atomic_t stopping;

static void stop(int number) {
    (void)number;
    stopping = 1;
}

void bytes_catch_signals(void) {
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction action = {.sa_handler = stop};

    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        sigaction(numbers[i], &action, NULL);
}

int bytes_write(int fd, const unsigned char *bytes, size_t size) {
    while (size) {
        ssize_t done = write(fd, bytes, size);

        if (done < 0 && errno == EINTR)
            continue;
        if (done < 0)
            return -errno;
        bytes += done;
        size -= (size_t)done;
    }
    return 0;
}

/* ---- Progress ---- */

static struct {
    uint64_t total, read; /* total: 0: none is shown */
    unsigned percent;     /* printed last */
} progress;

void bytes_show_progress(uint64_t total) {
    progress.total = total;
}

static void show_progress(size_t size) {
    progress.read += size;
    if (!progress.total || progress.read > progress.total)
        return;
    unsigned percent = (unsigned)((double)progress.read * 100 / (double)progress.total);
    while (progress.percent < percent)
        printf("%u %%\n", ++progress.percent);
    fflush(stdout);
}

/* ---- Reading ---- */

int bytes_read(int fd, bool direct, uint64_t size, int (*take)(void *to, const unsigned char *bytes, size_t size),
               void *to) {
    return bytes_read_from(fd, direct, 0, size, take, to);
}

int bytes_read_from(int fd, bool direct, uint64_t from, uint64_t size,
                    int (*take)(void *to, const unsigned char *bytes, size_t size), void *to) {
    uint64_t at = from / BLOCK * BLOCK; /* a read past the page cache begins with a whole block */
    unsigned char *piece;
    int result = 0;

    if (posix_memalign((void **)&piece, BLOCK, PIECE))
        return -ENOMEM;
    if (!direct)
        posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    while (at < size && !result) {
        ssize_t got = pread(fd, piece, PIECE, (off_t)at);
        size_t length = got > 0 && (uint64_t)got > size - at ? (size_t)(size - at) : (size_t)got;
        size_t skipped = from > at ? (size_t)(from - at) : 0;

        if (stopping)
            result = -EINTR;
        else if (got < 0)
            result = errno == EINTR ? 0 : -errno;
        else if (!got || (direct && at + length < size && length % BLOCK))
            result = -ENODATA;
        else if (length > skipped)
            result = take(to, piece + skipped, length - skipped);
        if (got > 0)
            at += length;
        if (got > 0)
            show_progress(length);
        if (got > 0 && !direct)
            posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    }
    free(piece);
    return result;
}
