/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXPANEL_RUN_H
#define DDXPANEL_RUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum run_end {
    RUN_EXITED,
    RUN_KILLED,    /* by a signal of another process */
    RUN_TOO_LONG,  /* killed after its time */
    RUN_TOO_MUCH,  /* killed after its output */
    RUN_NOT_WANTED /* killed, since its receiver wants no more */
};

struct run {
    enum run_end end;
    int status; /* exit status if RUN_EXITED, else a signal */
};

struct run_for {
    unsigned seconds; /* then it is killed */
    uint64_t output;  /* bytes; with more it is killed */
    int receiver;     /* socket: when its other end is closed, the program is killed; -1: none */
    bool (*take)(void *to, const char *bytes, size_t size); /* false: it is killed */
    void *to;
    bool apart; /* its standard errors are those of this process, and no output */
};

/*
 * Run a program (its path, then its words, then NULL) without a shell, without input, with the environment PATH only,
 * in a session of its own. Its output, standard errors with it unless they are apart, goes to take() as it comes.
 * At a limit all processes of its session are killed; else those that it left behind go on. 0, or -errno: it was not
 * started.
 */
int run_program(const char *const *command, const struct run_for *limits, struct run *run);

#endif
