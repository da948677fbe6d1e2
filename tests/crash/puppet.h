/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Programs that do one thing at a time, when they are told to, on the item "frames": what happens in which order is
 * written down in the test, and no time is in it.
 */
#ifndef PUPPET_H
#define PUPPET_H

#include "director.h"

enum order {
    ORDER_LOOKUP = 1, /* a handle */
    ORDER_KEEP,       /* n frames for it */
    ORDER_WRITE,      /* n frames; the number of the last; 0: it becomes the writer, no more */
    ORDER_JUMP,       /* its next frame has the number n, whatever the one before had */
    ORDER_NEXT,       /* as HOLD, but the oldest frame not yet seen */
    ORDER_HOLD,       /* the newest frame instead of what is held, waiting n seconds for it; its number */
    ORDER_LOOK,       /* at what is held: its number, -EBADMSG if it has changed */
    ORDER_RELEASE,
    ORDER_DONE,    /* gives the handle back */
    ORDER_SHORT,   /* how many writes were given up */
    ORDER_LIMIT,   /* room for n descriptors more; -1: for as many as may be */
    ORDER_FREE,    /* n looks at the handle's lock: how often it was free */
    ORDER_LEAVE,   /* the store, as after waiting for it in vain */
    ORDER_FORK,    /* a child that does nothing, for 30 s; its pid */
    ORDER_READERS, /* for whom it keeps frames, as the writer knows */
    ORDER_INFO,    /* what the store says of the item; the number of its readers */
    ORDER_HANG_UP, /* the connection is lost, and the program stopped before it notices */
};

struct puppet {
    pid_t pid; /* 0: none */
    int wire;
};

struct puppet *puppet_begin(const char *fault); /* as in DDX_FAULT, or NULL; it has a handle */
void puppet_say(struct puppet *puppet, enum order order, int64_t n);
int64_t puppet_hear(struct puppet *puppet);                                    /* the answer, or -errno */
int64_t puppet_ask(struct puppet *puppet, enum order order, int64_t n); /* both */
void puppet_stop(struct puppet *puppet);
void puppet_await_stop(struct puppet *puppet); /* it stops by itself */
void puppet_go_on(struct puppet *puppet);
void puppet_kill(struct puppet *puppet);
void puppets_end(void); /* all of them, and the store */

#define ASK(puppet, order, n, expected)                                                                             \
    do {                                                                                                            \
        int64_t got_ = puppet_ask(puppet, ORDER_##order, n), wanted_ = (expected);                                  \
        if (got_ != wanted_)                                                                                        \
            fail("%s:%d: " #puppet ": " #order " gives %lld, not %lld", __FILE__, __LINE__, (long long)got_,        \
                 (long long)wanted_);                                                                               \
    } while (0)

/* What the store says of the item; false: nothing. */
bool told_of(struct ddx_item_info *info);

int puppet_main(int wire); /* the program itself */

#endif
