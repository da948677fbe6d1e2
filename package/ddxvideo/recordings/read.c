/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "read.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "bytes.h"
#include "program.h"

struct reading {
    int hold, index_fd, fd; /* -1: none */
    bool direct;
    int write_error; /* 0: the file failed */
};

static int put(void *to, const unsigned char *bytes, size_t size) {
    struct reading *reading = to;

    while (size) {
        ssize_t done = write(STDOUT_FILENO, bytes, size);

        if (done < 0 && errno == EINTR)
            continue;
        if (done < 0)
            return reading->write_error = -errno;
        bytes += done;
        size -= (size_t)done;
    }
    return 0;
}

static int open_file(struct reading *reading, const struct folder *folder, const struct found *found) {
    int error = found->id ? found_hold(folder, found, &reading->hold) : 0;

    if (!error && found->id) {
        reading->index_fd = found_open_index(folder, found);
        error = reading->index_fd < 0 ? reading->index_fd : found_is_given_up(reading->index_fd, found) ? -EBUSY : 0;
    }
    if (error)
        return error;
    reading->fd = found_open(folder, found, &reading->direct);
    return reading->fd < 0 ? reading->fd : 0;
}

static void close_file(const struct reading *reading) {
    const int fds[] = {reading->fd, reading->index_fd, reading->hold};

    for (size_t i = 0; i < sizeof fds / sizeof fds[0]; i++)
        if (fds[i] >= 0)
            close(fds[i]);
}

int read_file(const struct folder *folder, const struct found *found, uint64_t from) {
    struct reading reading = {.hold = -1, .index_fd = -1, .fd = -1};

    if (found->state >= FOUND_INTERRUPTED) {
        say("%s: is not finished", found->shown);
        return EXIT_FAILED;
    }
    if (from > found->bytes) {
        say("%s: has %" PRIu64 " bytes only", found->shown, found->bytes);
        return EXIT_USAGE;
    }
    int error = open_file(&reading, folder, found);
    if (!error)
        error = bytes_read_from(reading.fd, reading.direct, from, found->bytes, put, &reading);
    /* Without a hold (another user's pool) the bytes may be those of a new recording. */
    if (!reading.write_error && error != -EINTR && reading.index_fd >= 0 && found_is_given_up(reading.index_fd, found))
        error = -EBUSY;
    if (reading.write_error)
        say("standard output: %s", strerror(-error));
    else if (error)
        say("%s: %s", found->shown,
            error == -EBUSY     ? "was given up for a new recording"
            : error == -EINTR   ? "not read to its end, told to stop"
            : error == -ENODATA ? "is shorter than its recording"
                                : strerror(-error));
    close_file(&reading);
    return error ? EXIT_FAILED : EXIT_OK;
}
