/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Keys of a terminal: each is recognized; the terminal's mode is restored, and untouched in the background. */
#include "keys.h"

#include <ddx.h>
#include <poll.h>
#include <pty.h>
#include <stdbool.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"
#include "surface.h"

#define TYPED ".\033[A\033OB\033[C\033[D\033[H\033[4~\xc3\xa4?\033[200~\033"
#define LATER (2 * KEYS_ESCAPE_MS * INT64_C(1000000))

static const int expected[] = {'.',          SURFACE_UP,  SURFACE_DOWN, SURFACE_RIGHT, SURFACE_LEFT,
                               SURFACE_HOME, SURFACE_END, '?',          SURFACE_ESCAPE};

static bool echoes(void) {
    struct termios mode;

    CHECK(!tcgetattr(STDIN_FILENO, &mode));
    return mode.c_lflag & ECHO;
}

/* A process in the background would be stopped if it read or changed the mode. */
static void in_background(void) {
    struct keys keys;

    CHECK(!setpgid(0, 0));
    keys_open(&keys);
    CHECK(keys.wanted);
    CHECK_EQUAL(keys_ready(&keys), KEYS_NONE);
    CHECK(echoes());
    keys.raw = true; /* as if it had been in the foreground before */
    CHECK(keys_read(&keys));
    keys_close(&keys);
    _exit(0);
}

/* A process of another session, as after setsid: the terminal exists, but is not its controlling terminal. */
static void detached(void) {
    struct keys keys;

    CHECK(setsid() >= 0);
    keys_open(&keys);
    CHECK_EQUAL(keys_ready(&keys), KEYS_NONE);
    CHECK(echoes());
    _exit(0);
}

static int next_key(struct keys *keys) {
    struct pollfd entry = {.fd = STDIN_FILENO, .events = POLLIN};
    int key;

    while (!(key = keys_next(keys, ddx_time_now()))) {
        CHECK_EQUAL(keys_ready(keys), KEYS_LISTEN);
        if (poll(&entry, 1, KEYS_ESCAPE_MS) > 0)
            CHECK(keys_read(keys));
    }
    return key;
}

static void in_foreground(void) {
    struct keys keys;

    keys_open(&keys);
    for (unsigned i = 0; i < sizeof expected / sizeof *expected; i++)
        CHECK_EQUAL(next_key(&keys), expected[i]);
    CHECK(!echoes());
    keys_close(&keys);
    CHECK(echoes());
}

static void in_child(void (*check)(void)) {
    int status;
    pid_t child = fork();

    if (!child)
        check();
    CHECK_EQUAL(waitpid(child, &status, WUNTRACED), child);
    CHECK(WIFEXITED(status) && !WEXITSTATUS(status));
}

/* The first process of a session on a new terminal. */
static void session(void) {
    in_child(in_background);
    in_child(detached);
    in_foreground();
    _exit(0);
}

/* Copies the terminal's output: its buffer must not fill, and failed checks must be seen. */
static void drain(int terminal) {
    char text[256];
    ssize_t got;

    while ((got = read(terminal, text, sizeof text)) > 0)
        fwrite(text, 1, (size_t)got, stderr);
}

int main(void) {
    struct keys sequence = {.byte = "\033[", .count = 2};
    int terminal, status;

    CHECK_EQUAL(keys_next(&sequence, 0), 0);
    CHECK_EQUAL(keys_next(&sequence, LATER), SURFACE_ESCAPE);
    CHECK_EQUAL(keys_next(&sequence, LATER), '[');
    struct keys endless = {.count = sizeof endless.byte};
    memset(endless.byte, '0', sizeof endless.byte);
    memcpy(endless.byte, "\033[", 2);
    CHECK_EQUAL(keys_next(&endless, 0), 0);
    CHECK_EQUAL(endless.count, 0);

    pid_t child = forkpty(&terminal, NULL, NULL, NULL);
    if (!child)
        session();
    CHECK_EQUAL(write(terminal, TYPED, sizeof TYPED - 1), sizeof TYPED - 1);
    drain(terminal);
    CHECK_EQUAL(waitpid(child, &status, 0), child);
    CHECK(WIFEXITED(status) && !WEXITSTATUS(status));
    return 0;
}
