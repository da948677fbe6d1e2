/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "keys.h"

#include <ddx.h>
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#include "ddx_time.h"
#include "surface.h"

#define ESCAPE 27
#define DELETE 127
#define BEYOND_UNICODE 0x110000

/* If the program loses the foreground at this moment, it gets an error instead of a stop. */
static sigset_t hold_signals(void) {
    sigset_t set, before;

    sigemptyset(&set);
    sigaddset(&set, SIGTTIN);
    sigaddset(&set, SIGTTOU);
    pthread_sigmask(SIG_BLOCK, &set, &before);
    return before;
}

void keys_open(struct keys *keys) {
    *keys = (struct keys){.wanted = tcgetpgrp(STDIN_FILENO) >= 0};
}

static bool is_foreground(void) {
    return tcgetpgrp(STDIN_FILENO) == getpgrp();
}

static void set_mode(const struct termios *mode) {
    sigset_t before = hold_signals();

    if (is_foreground())
        tcsetattr(STDIN_FILENO, TCSANOW, mode);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

void keys_close(struct keys *keys) {
    if (keys->raw)
        set_mode(&keys->before);
    *keys = (struct keys){.wanted = false};
}

/* The shell may have changed the mode while it had the foreground. */
static void take_over(struct keys *keys) {
    struct termios mode;

    if (tcgetattr(STDIN_FILENO, &mode) || (keys->raw && !(mode.c_lflag & (ICANON | ECHO))))
        return;
    keys->before = mode;
    keys->raw = true;
    mode.c_lflag &= ~(tcflag_t)(ICANON | ECHO); /* ISIG stays, so Ctrl-C and Ctrl-Z work as in each program */
    mode.c_cc[VMIN] = 1;
    mode.c_cc[VTIME] = 0;
    set_mode(&mode);
}

enum keys_state keys_ready(struct keys *keys) {
    if (!keys->wanted)
        return KEYS_NONE;
    if (tcgetpgrp(STDIN_FILENO) < 0) {
        keys->wanted = false;
        return KEYS_GONE;
    }
    if (!is_foreground())
        return KEYS_NONE;
    take_over(keys);
    return KEYS_LISTEN;
}

bool keys_read(struct keys *keys) {
    sigset_t before = hold_signals();
    ssize_t got = read(STDIN_FILENO, keys->byte + keys->count, sizeof keys->byte - (size_t)keys->count);
    bool gone = got == 0 || (got < 0 && errno != EINTR && errno != EAGAIN && is_foreground());

    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (got > 0)
        keys->count += (int)got;
    keys->read = ddx_time_now();
    if (gone)
        keys->wanted = false;
    return !gone;
}

/* ---- Keys from bytes ---- */

static void drop(struct keys *keys, int count) {
    keys->count -= count;
    memmove(keys->byte, keys->byte + count, (size_t)keys->count);
}

static int by_letter(unsigned char letter) {
    static const char letters[] = "ABCDHF";
    static const int keys[] = {SURFACE_UP, SURFACE_DOWN, SURFACE_RIGHT, SURFACE_LEFT, SURFACE_HOME, SURFACE_END};
    const char *found = letter ? strchr(letters, letter) : NULL;

    return found ? keys[found - letters] : 0;
}

static int by_number(unsigned char digit) {
    return digit == '1' || digit == '7' ? SURFACE_HOME : digit == '4' || digit == '8' ? SURFACE_END : 0;
}

/* The sequence that begins with an escape character: its length, 0 if it is not complete, and its key (0: none). */
static int sequence(const struct keys *keys, int *key) {
    const unsigned char *byte = keys->byte;
    int at = 2;

    *key = 0;
    if (keys->count < 2)
        return 0;
    if (byte[1] != '[' && byte[1] != 'O') {
        *key = SURFACE_ESCAPE;
        return 1;
    }
    while (at < keys->count && byte[at] < '@') /* parameters */
        at++;
    if (at == keys->count)
        return at == sizeof keys->byte ? at : 0;
    *key = byte[at] == '~' && at == 3 ? by_number(byte[2]) : at == 2 ? by_letter(byte[at]) : 0;
    return at + 1;
}

/* Characters beyond ASCII are ignored. */
static bool is_key(int key) {
    return (key > 0 && key < DELETE) || key >= BEYOND_UNICODE;
}

int keys_next(struct keys *keys, int64_t now) {
    while (keys->count) {
        int key = keys->byte[0], length = 1;

        if (key == ESCAPE) {
            length = sequence(keys, &key);
            if (!length && now - keys->read < KEYS_ESCAPE_MS * MS)
                return 0;
            key = length ? key : SURFACE_ESCAPE;
            length = length ? length : 1;
        }
        drop(keys, length);
        if (is_key(key))
            return key;
    }
    return 0;
}
