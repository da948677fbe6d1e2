/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef TAKEOVER_H
#define TAKEOVER_H

#include "director.h"

/* All in ns. */
struct takeover {
    int64_t whole;     /* from the writer's death until the first reader has the first frame of the next; its parts: */
    int64_t noticed;   /* the store knows of the death */
    int64_t granted;   /* another program has asked, has got memory, and may write */
    int64_t published; /* it has looked at the last frame and written its first */
    int64_t seen;      /* a reader has it */
};

/* Run everything from now on with real-time priority. False if that is not allowed here. */
bool takeover_urgent(void);
/* Right before the writer is killed. */
void takeover_begin(void);
struct takeover takeover_done(unsigned stream, uint32_t term, int64_t since, const struct party *first_reader);
const char *takeover_text(const struct takeover *takeover);             /* until the next call */
void takeover_check(const struct takeover *takeover, const char *when); /* fails if it took too long */

#endif
