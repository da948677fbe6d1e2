/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reads keys from the terminal on standard input. In the background, the program does not touch the terminal. */
#ifndef DDXVIDEO_KEYS_H
#define DDXVIDEO_KEYS_H

#include <stdbool.h>
#include <stdint.h>
#include <termios.h>

#define KEYS_ESCAPE_MS 50 /* characters within this time after an escape character belong to it */

/* All 0 at first. */
struct keys {
    bool wanted; /* standard input is the terminal of this session */
    bool raw;    /* the terminal is in raw mode now; its former mode: */
    struct termios before;
    unsigned char byte[32]; /* bytes that were read, but are no complete key yet */
    int count;
    int64_t read; /* when they were read, ns of CLOCK_MONOTONIC */
};

enum keys_state { KEYS_NONE, KEYS_LISTEN, KEYS_GONE };

void keys_open(struct keys *keys);
void keys_close(struct keys *keys);

/* Call before each wait: whether to wait for standard input as well. In the foreground, it takes over the terminal. */
enum keys_state keys_ready(struct keys *keys);

/* Standard input is readable. False: the terminal is gone. */
bool keys_read(struct keys *keys);

/* The next key, numbered as in surface.h; 0: none yet. Never waits. `now` is CLOCK_MONOTONIC. */
int keys_next(struct keys *keys, int64_t now);

#endif
