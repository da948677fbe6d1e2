/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "read.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "bytes.h"
#include "program.h"

/* `to`: the error of a write. */
static int put(void *to, const unsigned char *bytes, size_t size) {
    int *write_error = to;

    return *write_error = bytes_write(STDOUT_FILENO, bytes, size);
}

int read_file(const struct folder *folder, const struct found *found, uint64_t from) {
    struct found_use use;
    int write_error = 0;

    if (found->state >= FOUND_INTERRUPTED) {
        say("%s: is not finished", found->shown);
        return EXIT_FAILED;
    }
    if (from > found->bytes) {
        say("%s: has %" PRIu64 " bytes only", found->shown, found->bytes);
        return EXIT_USAGE;
    }
    int error = found_open(folder, found, &use);
    if (!error && found_is_given_up(&use, found)) /* nothing of a new recording is written */
        error = -EBUSY;
    if (!error)
        error = bytes_read_from(use.fd, use.direct, from, found->bytes, put, &write_error);
    /* Without a hold (another user's pool) the bytes may be those of a new recording. */
    if (!write_error && error != -EINTR && found_is_given_up(&use, found))
        error = -EBUSY;
    if (write_error)
        say("standard output: %s", strerror(-error));
    else if (error)
        say("%s: %s", found->shown,
            error == -EBUSY     ? "was given up for a new recording"
            : error == -EINTR   ? "not read to its end, told to stop"
            : error == -ENODATA ? "is shorter than its recording"
                                : strerror(-error));
    found_close(&use);
    return error ? EXIT_FAILED : EXIT_OK;
}
