/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The first TERM ends a program's wait; a second one does not disturb its final work. */
#include <errno.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"
#include "program.h"

#define PAUSE 100000 /* us; for a signal to act */

static bool sleeps(pid_t pid) {
    char path[40], state = 0;

    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *file = fopen(path, "r");
    CHECK(file);
    CHECK(fscanf(file, "%*d (%*[^)]) %c", &state) == 1);
    fclose(file);
    return state == 'S';
}

/* Sends TERM to the waiting parent, and writes a byte a little later. */
static void tell(int pipe) {
    pid_t parent = getppid();

    while (!sleeps(parent))
        usleep(1000);
    kill(parent, SIGTERM);
    usleep(PAUSE);
    _exit(write(pipe, "", 1) != 1);
}

/* The result of a read during which TERM comes. */
static ssize_t read_while_told(void) {
    int ends[2], status;
    char byte;

    CHECK_EQUAL(pipe(ends), 0);
    pid_t child = fork();
    CHECK(child >= 0);
    if (!child)
        tell(ends[1]);
    ssize_t got = read(ends[0], &byte, 1);
    int error = errno;
    CHECK_EQUAL(waitpid(child, &status, 0), child);
    CHECK_EQUAL(status, 0);
    close(ends[0]);
    close(ends[1]);
    return got < 0 ? -error : got;
}

int main(void) {
    signals_catch();
    CHECK(!program_stopping());
    CHECK_EQUAL(read_while_told(), -EINTR);
    CHECK(program_stopping());
    CHECK_EQUAL(read_while_told(), 1);
    return 0;
}
