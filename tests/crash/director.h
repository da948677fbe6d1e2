/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Starts, stops and watches the parties of a crash test. Every wait has a bound, beyond which it counts as a hang. */
#ifndef DIRECTOR_H
#define DIRECTOR_H

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/types.h>

#include "stage.h"

/*
 * Limits in ns of a takeover with a running store. TAKEOVER: until a reader has a frame, on a busy machine, with
 * readers that hold frames for 120 ms. TAKEOVER_URGENT: until a frame is published, with real-time priority.
 */
#define TAKEOVER 8000000000
#define TAKEOVER_URGENT 100000000

#define HANG 8000000000 /* ns: on a busy machine a program may not run for seconds */

struct party {
    pid_t pid; /* 0: none */
    unsigned index, stream;
    char kind;
    bool stopped; /* not waited for */
};
extern struct party party[ACTORS];
extern pid_t store_process;
extern int store_log;              /* file for its messages; -1: ours */
extern const char *store_budget;   /* -m */
extern unsigned store_descriptors; /* limit; 0: the maximum */

void director_begin(void);
void director_end(void); /* stops all parties with TERM */

void store_begin(const char *fault);
pid_t store_worker(void); /* 0: there is none now */
void store_kill_worker(void);
void store_kill(void);  /* worker and holder */
void store_ended(void); /* waits until both have died by themselves */
void store_stop(void);  /* both are stopped when this returns */
void store_go_on(void); /* also if only the worker was stopped */
/* Starts a party in a free place; `fault` as in DDX_FAULT, or NULL. */
struct party *party_begin(char kind, unsigned stream, double period, const char *fault);
void party_end(struct party *party, int number);   /* sends the signal, waits for the exit */
void party_ended(struct party *party, int number); /* waits until it has died of this signal */
void party_stop(struct party *party);              /* not waited for from now on */
void party_go_on(struct party *party);
struct actor *actor_of(const struct party *party);
struct party *owner_of(unsigned stream); /* the writer; NULL: dead */

void fail(const char *format, ...) __attribute__((noreturn, format(printf, 1, 2)));
void waited(int64_t ns); /* a wait succeeded; director_end() prints the longest */
void look(void);         /* fails if a party has complained, or exited unexpectedly */

#define AWAIT(condition, ...)                   \
    do {                                        \
        int64_t since_ = ddx_time_now();        \
        while (!(condition)) {                  \
            look();                             \
            if (ddx_time_now() > since_ + HANG) \
                fail("hang: " __VA_ARGS__);     \
            nap(0.001);                         \
        }                                       \
        waited(ddx_time_now() - since_);        \
    } while (0)

/* All readers of the stream get frames, of this term or a later one. */
void await_frames(unsigned stream, unsigned frames, uint32_t term, const char *when);
/* Wait until a new writer writes. Returns the reader that saw its first frame first; NULL if all came later. */
struct party *await_takeover(unsigned stream, uint32_t term, const char *when);
/* The longest time without a frame among the readers of a stream, since the last call; ns. */
int64_t longest_gap(unsigned stream);

#endif
