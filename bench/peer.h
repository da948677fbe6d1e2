/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The functions that main.c calls of each way to pass frames. Everything that is measured, and the measuring itself, is
 * in main.c, the same for all; a peer only moves frames. int functions return 0; else they print an error and return
 * another number.
 */
#ifndef PEER_H
#define PEER_H

#include <stdbool.h>
#include <stddef.h>

enum peer_mode {
    PEER_ZEROCOPY, /* the writer fills the frame where the readers find it, and they look at it there */
    PEER_COPY,     /* the writer has the frame in memory of its own, and each reader gets it in memory of its own */
    PEER_DIRECT    /* ddx only: zero copy, and the reader sees each frame at the same address */
};

struct peer_setup {
    const char *name; /* of the channel; a file name, too */
    size_t bytes;     /* of a frame */
    unsigned readers;
    enum peer_mode mode;
    void *own; /* PEER_COPY: the program's own frame; whole pages, touched before */
};

int peer_open(const struct peer_setup *setup, bool writer);

void *peer_loan(void); /* PEER_ZEROCOPY: the memory of the next frame */
int peer_publish(void);
int peer_write(const void *data); /* PEER_COPY */

/*
 * Sleep (never poll) until the next frame is there, at most about 100 ms, and call `deliver` with it, while it cannot
 * change. Not to call `deliver` is no error.
 */
int peer_receive(void (*deliver)(const void *data));

void peer_close(void); /* removes all that the peer made */

#endif
