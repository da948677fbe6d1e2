/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Keys of the terminal on standard input, one by one, without touching a terminal in whose background we are. */
#ifndef DDXVIDEO_KEYS_H
#define DDXVIDEO_KEYS_H

#include <stdbool.h>
#include <stdint.h>
#include <termios.h>

#define KEYS_ESCAPE_MS 50 /* what follows an escape character within this time belongs to it */

/* All 0 at first. */
struct keys {
    bool wanted;           /* standard input is the terminal of our session */
    bool raw;              /* it is in our mode now, and was in this one: */
    struct termios before;
    unsigned char byte[32]; /* read, and not a key yet */
    int count;
    int64_t read; /* when, ns of CLOCK_MONOTONIC */
};

enum keys_state { KEYS_NONE, KEYS_LISTEN, KEYS_GONE };

void keys_open(struct keys *keys);
void keys_close(struct keys *keys);

/* Before each wait: whether standard input is to be waited for. Takes the terminal over in the foreground. */
enum keys_state keys_ready(struct keys *keys);

/* Standard input is readable. False: the terminal is gone. */
bool keys_read(struct keys *keys);

/* The next key, as of surface.h; 0: none yet. Never waits. `now` is CLOCK_MONOTONIC. */
int keys_next(struct keys *keys, int64_t now);

#endif
