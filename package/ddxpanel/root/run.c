/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "run.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "clock.h"

#define NOT_STARTED 127
#define PIECE 4096

/* In the child. It gets standard input, output and errors, and no other descriptor: neither sockets nor keys. */
_Noreturn static void become(const char *const *command, int output, bool apart) {
    static char path[] = "PATH=/usr/sbin:/usr/bin:/sbin:/bin";
    static char *const environment[] = {path, NULL};
    sigset_t none;
    int nothing = open("/dev/null", O_RDONLY);

    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    signal(SIGPIPE, SIG_DFL);
    setsid();
    if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0 || dup2(output, STDOUT_FILENO) < 0 ||
        (!apart && dup2(output, STDERR_FILENO) < 0) || close_range(3, ~0u, 0))
        _exit(NOT_STARTED);
    execve(command[0], (char *const *)command, environment); /* changes none of the words */
    _exit(NOT_STARTED);
}

/* Reads until the output ends, or until a limit is reached. */
static enum run_end follow(int from, int64_t until, const struct run_for *limits) {
    uint64_t room = limits->output;
    char piece[PIECE];

    for (;;) {
        int64_t left = until - clock_ms();
        struct pollfd wait[] = {{.fd = from, .events = POLLIN}, {.fd = limits->receiver}};

        if (left <= 0)
            return RUN_TOO_LONG;
        if (poll(wait, 2, (int)left) <= 0)
            continue;
        if (wait[1].revents)
            return RUN_NOT_WANTED;
        ssize_t got = read(from, piece, sizeof piece);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return RUN_EXITED;
        if ((uint64_t)got > room)
            return RUN_TOO_MUCH;
        room -= (uint64_t)got;
        if (!limits->take(limits->to, piece, (size_t)got))
            return RUN_NOT_WANTED;
    }
}

/* The output may end, closed by the program, before the program does. */
static bool exited_by(pid_t child, int64_t until) {
    siginfo_t end = {.si_pid = 0};

    while (clock_ms() < until) {
        if (!waitid(P_PID, (id_t)child, &end, WEXITED | WNOHANG | WNOWAIT) && end.si_pid)
            return true;
        poll(NULL, 0, 10);
    }
    return false;
}

int run_program(const char *const *command, const struct run_for *limits, struct run *run) {
    int64_t until = clock_ms() + (int64_t)limits->seconds * 1000;
    int ends[2], status;

    if (pipe2(ends, O_CLOEXEC))
        return -errno;
    pid_t child = fork();
    if (!child)
        become(command, ends[1], limits->apart);
    int error = child < 0 ? -errno : 0;
    close(ends[1]);
    if (!error) {
        run->end = follow(ends[0], until, limits);
        if (run->end == RUN_EXITED && !exited_by(child, until))
            run->end = RUN_TOO_LONG;
        if (run->end != RUN_EXITED) {
            kill(-child, SIGKILL); /* its children as well; it is not reaped yet, so the number is still its own */
            kill(child, SIGKILL);  /* before its setsid() */
        }
        while (waitpid(child, &status, 0) < 0 && errno == EINTR)
            continue;
        run->status = WIFEXITED(status) ? WEXITSTATUS(status) : WTERMSIG(status);
        if (run->end == RUN_EXITED && !WIFEXITED(status))
            run->end = RUN_KILLED;
        if (run->end == RUN_EXITED && run->status == NOT_STARTED)
            error = -ENOENT;
    }
    close(ends[0]);
    return error;
}
