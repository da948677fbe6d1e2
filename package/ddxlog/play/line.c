/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Lines on standard input; signals are served while waiting. */
#include "line.h"

#include <poll.h>
#include <unistd.h>

bool replay_wait_line(struct replay *replay) {
    for (;;) {
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        char c;

        program_tick(replay->book);
        if (program_stopping())
            return false;
        if (poll(&input, 1, 200) <= 0)
            continue;
        ssize_t size = read(STDIN_FILENO, &c, 1);
        if (size <= 0)
            return false;
        if (c == '\n')
            return true;
    }
}
