/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Copies standard input to standard output and to the first serial line, which is written and never read: the robot may
 * have a GPS there. In a terminal's default mode, bytes of that device would be echoed, stop the output (Ctrl-S) or
 * kill programs (Ctrl-C). The line does not become a controlling terminal here, and remains in raw mode.
 */
#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#define LINE "/dev/ttyS0"
#define PATIENCE 1000 /* ms to wait for space in the line's buffer */

static int open_line(void) {
    struct termios mode;
    int line = open(LINE, O_WRONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);

    if (line < 0 || tcgetattr(line, &mode))
        return -1; /* the machine has no serial line */
    cfmakeraw(&mode);
    mode.c_oflag = OPOST | ONLCR;
    mode.c_cflag = (mode.c_cflag & ~(tcflag_t)CRTSCTS) | CLOCAL | CREAD;
    /* TCSANOW: stty would wait until all output is sent, which a device's Ctrl-S may delay for ever. */
    tcsetattr(line, TCSANOW, &mode);
    return line;
}

static void copy(int to, const char *text, ssize_t left) {
    while (left > 0) {
        ssize_t done = write(to, text, (size_t)left);

        if (done <= 0) {
            struct pollfd room = {.fd = to, .events = POLLOUT};

            if (poll(&room, 1, PATIENCE) <= 0 || !(room.revents & POLLOUT))
                return;
            continue;
        }
        text += done;
        left -= done;
    }
}

int main(void) {
    char text[1024];
    ssize_t length;
    int line = open_line();

    while ((length = read(STDIN_FILENO, text, sizeof text)) > 0) {
        copy(STDOUT_FILENO, text, length);
        copy(line, text, length);
    }
    return 0;
}
