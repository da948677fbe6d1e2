/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Items that are being watched: for each one a process of ddxvideosnap, which is asked for one picture after another.
 * The web process itself neither reads the store nor encodes.
 */
#ifndef DDXPANEL_WATCH_H
#define DDXPANEL_WATCH_H

#include <sys/types.h>

#include "picture.h"

#define WATCHES 3         /* items at a time */
#define WATCH_IDLE 5000   /* ms without a request, then the process is stopped */
#define WATCH_HANGS 10000 /* ms without an answer, then it is stopped */

/* A picture for all visitors that wait for it. */
struct picture {
    unsigned holders; /* freed with the last one */
    struct picture_said said;
    unsigned char bytes[];
};

struct watch {
    pid_t process;                /* 0: free */
    int to, from;                 /* its standard input and output */
    bool asked;                   /* an answer is expected */
    struct picture_wanted wanted; /* its item; the last request */
    int64_t used, since;          /* ms: last request of a visitor, last request to the process */
    char line[PICTURE_LINE];
    size_t line_size;
    struct picture *picture; /* that is being received */
    size_t got;              /* bytes of it */
};

/* The watch of an item, which is started if there is none. NULL, and *reason, if that is not possible. */
struct watch *watch_open(struct watch watches[WATCHES], const char *item, int64_t now, const char **reason);

/* The watch of an item; NULL: there is none. */
struct watch *watch_find(struct watch watches[WATCHES], const char *item);

/* Ask for a picture. False: the process is gone. Only if no answer is expected. */
bool watch_ask(struct watch *watch, const struct picture_wanted *wanted, int64_t now);

/*
 * Read what there is of an answer. True: it is complete, or the process is gone; *said is the answer then, and *picture
 * the picture, which the caller drops, or NULL. After a refusal the watch is to be closed; the reason is valid until
 * then.
 */
bool watch_hear(struct watch *watch, struct picture_said *said, struct picture **picture);

void watch_close(struct watch *watch);

struct picture *picture_hold(struct picture *picture);
void picture_drop(struct picture *picture); /* NULL is allowed */

#endif
