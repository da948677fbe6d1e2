/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <unistd.h>

#include <ddx.h>

#include "log.h"

#define PROGRAM "ddxstore"
#define NOTES 100 /* lines a second at most */

/*
 * The log's reader may be stopped, or its disk full: the store does not wait for it. A pipe that poll() reports as
 * writable has room for PIPE_BUF bytes.
 */
bool log_text(int fd, const char *text, size_t length) {
    struct pollfd room = {.fd = fd, .events = POLLOUT};

    if (poll(&room, 1, 0) != 1 || !(room.revents & POLLOUT))
        return false;
    return write(fd, text, length) == (ssize_t)length;
}

void log_line(const char *format, ...) {
    static int64_t second;
    static unsigned lines, left_out;
    char text[512] = PROGRAM ": ";
    const int begin = sizeof PROGRAM ": " - 1;
    va_list arguments;

    /* A client that sends bad requests as fast as it can must not fill the log. */
    if (ddx_time_now() / 1000000000 != second)
        lines = 0;
    second = ddx_time_now() / 1000000000;
    if (left_out && lines < NOTES) {
        int length = snprintf(text + begin, sizeof text - (size_t)begin, "%u lines were left out\n", left_out) + begin;

        left_out = log_text(2, text, (size_t)length) ? 0 : left_out;
    }
    va_start(arguments, format);
    int length = vsnprintf(text + begin, sizeof text - (size_t)begin - 1, format, arguments) + begin;
    va_end(arguments);
    if (length > (int)sizeof text - 2)
        length = (int)sizeof text - 2;
    text[length++] = '\n';
    if (lines++ >= NOTES || !log_text(2, text, (size_t)length))
        left_out++;
}
