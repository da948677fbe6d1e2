/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Programs that execute one order at a time on the item "frames": the test states what happens in which order, without
 * any times.
 */
#ifndef PUPPET_H
#define PUPPET_H

#include "director.h"

enum order {
    ORDER_LOOKUP = 1, /* a handle */
    ORDER_KEEP,       /* n frames for it */
    ORDER_WRITE,      /* n frames; the number of the last; 0: only becomes the writer */
    ORDER_JUMP,       /* its next frame gets the number n */
    ORDER_NEXT,       /* as HOLD, but the oldest frame not yet seen */
    ORDER_HOLD,       /* releases, then holds the newest frame, waiting n seconds; its number */
    ORDER_LOOK,       /* checks the held frame: its number, -EBADMSG if it has changed */
    ORDER_RELEASE,
    ORDER_DONE,    /* gives the handle back */
    ORDER_SHORT,   /* number of dropped writes */
    ORDER_LIMIT,   /* room for n more descriptors; -1: no limit */
    ORDER_FREE,    /* checks the handle's lock n times: how often it was free */
    ORDER_LEAVE,   /* leaves the store, as after waiting for it in vain */
    ORDER_FORK,    /* starts a child that does nothing for 30 s; its pid */
    ORDER_READERS, /* number of readers that the writer keeps frames for */
    ORDER_INFO,    /* the store's number of the item's readers */
    ORDER_HANG_UP, /* the connection is lost, and the program stopped before it notices */
};

struct puppet {
    pid_t pid; /* 0: none */
    int wire;
};

struct puppet *puppet_begin(const char *fault); /* as in DDX_FAULT, or NULL; it has a handle */
void puppet_say(struct puppet *puppet, enum order order, int64_t n);
int64_t puppet_hear(struct puppet *puppet); /* waits for the answer; -errno after a failure */
int64_t puppet_ask(struct puppet *puppet, enum order order, int64_t n); /* say, then hear */
void puppet_stop(struct puppet *puppet);
void puppet_await_stop(struct puppet *puppet); /* it stops by itself */
void puppet_go_on(struct puppet *puppet);
void puppet_kill(struct puppet *puppet);
void puppets_end(void); /* all of them, and the store */

#define ASK(puppet, order, n, expected)                                                                      \
    do {                                                                                                     \
        int64_t got_ = puppet_ask(puppet, ORDER_##order, n), wanted_ = (expected);                           \
        if (got_ != wanted_)                                                                                 \
            fail("%s:%d: " #puppet ": " #order " gives %lld, not %lld", __FILE__, __LINE__, (long long)got_, \
                 (long long)wanted_);                                                                        \
    } while (0)

/* The store's description of the item; false: none. */
bool read_info(struct ddx_item_info *info);

int puppet_main(int wire); /* the program itself */

#endif
