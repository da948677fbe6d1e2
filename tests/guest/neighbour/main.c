/* SPDX-License-Identifier: GPL-2.0-or-later */
/* neighbour FILE HERTZ: a program on the same disk that syncs each of its writes at once. Stops on TERM; prints
 * the number of syncs. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t stop;

static void on_term(int signal) {
    (void)signal;
    stop = 1;
}

int main(int argc, char **argv) {
    static const char block[4096];
    int fd = argc == 3 ? open(argv[1], O_WRONLY | O_CREAT | O_APPEND, 0644) : -1;
    double hertz = argc == 3 ? atof(argv[2]) : 0;
    unsigned times = 0;
    if (fd < 0 || hertz < 0.01)
        return 2;
    signal(SIGTERM, on_term);
    struct timespec begin, now;
    for (; !stop; times++) {
        clock_gettime(CLOCK_MONOTONIC, &begin);
        if (write(fd, block, sizeof(block)) < 0 || fsync(fd))
            return 1;
        clock_gettime(CLOCK_MONOTONIC, &now);
        double left = 1 / hertz - (double)(now.tv_sec - begin.tv_sec) - 1e-9 * (double)(now.tv_nsec - begin.tv_nsec);
        if (left > 0)
            usleep((useconds_t)(1e6 * left));
    }
    printf("%u\n", times);
    return 0;
}
