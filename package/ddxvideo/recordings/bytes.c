/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bytes.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
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

int bytes_read(int fd, bool direct, uint64_t size, int (*take)(void *to, const unsigned char *bytes, size_t size),
               void *to) {
    unsigned char *piece;
    int result = 0;

    if (posix_memalign((void **)&piece, BLOCK, PIECE))
        return -ENOMEM;
    if (!direct)
        posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    for (uint64_t at = 0; at < size && !result;) {
        ssize_t got = pread(fd, piece, PIECE, (off_t)at);
        size_t length = got > 0 && (uint64_t)got > size - at ? (size_t)(size - at) : (size_t)got;

        if (stopping)
            result = -EINTR;
        else if (got < 0)
            result = errno == EINTR ? 0 : -errno;
        else if (!got || (direct && at + length < size && length % BLOCK))
            result = -ENODATA;
        else
            result = take(to, piece, length);
        if (got > 0)
            at += length;
        if (got > 0 && !direct)
            posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    }
    free(piece);
    return result;
}
