/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Starts, ends and watches the parties of a crash test. Every wait has a bound; what does not come then is a hang. */
#ifndef DIRECTOR_H
#define DIRECTOR_H

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/types.h>

#include "stage.h"

#define TAKEOVER 1000000000 /* ns at most, with the store there; 20 ms is usual, but the machine may be busy */

extern double hang; /* seconds: 8, since on a busy machine a program may well not run for one; or DDX_CRASH_HANG */

struct party {
    pid_t pid; /* 0: none */
    unsigned index, stream;
    char kind;
    bool stopped; /* nobody waits for it */
};
extern struct party party[ACTORS];
extern pid_t store_process;
extern unsigned store_descriptors; /* at most; 0: as many as there may be */
extern unsigned checks;            /* waits that ended well */

void director_begin(void);
void director_end(void); /* ends all in peace */

void store_begin(const char *fault);
void store_kill(void);
/* A free place on the stage; `fault` as in DDX_FAULT, or NULL. */
struct party *party_begin(char kind, unsigned stream, double period, const char *fault);
void party_end(struct party *party, int number);   /* sends the signal, waits for the end */
void party_ended(struct party *party, int number); /* it has died of this signal: waits for that */
struct actor *actor_of(const struct party *party);
struct party *owner_of(unsigned stream); /* who writes; NULL: dead */

void fail(const char *format, ...) __attribute__((noreturn, format(printf, 1, 2)));
void look(void); /* has any party complained? has one ended that nobody ended? */

#define AWAIT(condition, ...)                                    \
    do {                                                         \
        int64_t until_ = ddx_time_now() + (int64_t)(hang * 1e9); \
        while (!(condition)) {                                   \
            look();                                              \
            if (ddx_time_now() > until_)                         \
                fail("hang: " __VA_ARGS__);                      \
            nap(0.0002);                                         \
        }                                                        \
        checks++;                                                \
    } while (0)

/* All readers of the stream get frames, of this term or a later one. */
void await_frames(unsigned stream, unsigned frames, uint32_t term, const char *when);
/* Wait until one who did not write before writes; ns from `since` until the first reader saw its first frame. */
int64_t await_takeover(unsigned stream, uint32_t term, int64_t since, const char *when);
/* The longest time without a frame among the readers of a stream, since the last call; ns. */
int64_t longest_gap(unsigned stream);

#endif
