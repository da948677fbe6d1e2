/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The common part of live sources: a history, and a thread that fills it. */
#ifndef DDXVIDEO_LIVE_H
#define DDXVIDEO_LIVE_H

#include "history.h"
#include "source.h"
#include "surface.h"

struct live {
    struct source source;
    struct history history;
    struct surface *surface;
    pthread_t thread;
    atomic_bool stopping, failed;
    pthread_mutex_t lock; /* of text */
    char text[120];
};

/* Fill in the common part. False: no memory. */
bool live_open(struct live *live, const char *name, const struct source_limits *limits, struct surface *surface);
/* The thread has ended. */
void live_close(struct live *live);

/* For the thread: add a picture (arrival 0: now); set the text of what the source waits for ("": nothing). */
void live_add(struct live *live, struct shot *shot);
void live_say(struct live *live, const char *text);

#endif
