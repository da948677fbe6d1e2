/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A file that all parties of the crash tests map, independent of the store. Each party records its own actions there,
 * so that the library's counts can be compared with the facts.
 */
#ifndef STAGE_H
#define STAGE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "../../package/ddx/lib/fault.h"
#include "ddx.h"

#define WORDS 1000
#define ACTORS 24
#define STREAMS 2
#define TERMS 32768
#define DELAYS 1024

DDX_STORE_TYPE(
    FRAME, struct {
        uint64_t number; /* counted by the writers, across changes of writer */
        uint64_t term;
        uint64_t word[WORDS];
    });

static inline uint64_t content(uint64_t number, uint64_t term, unsigned word) {
    return (number * 0x9e3779b97f4a7c15u ^ term * 0xbf58476d1ce4e5b9u) + word;
}

/* One writer's term, from its first frame: the frames that it began to publish, and those it knows to be published. */
struct term {
    _Atomic(uint64_t) first, begun, done;
    _Atomic(int64_t) time; /* of the first one's publishing */
};

struct stream {
    _Atomic(uint64_t) begun, done; /* as in its terms */
    _Atomic(uint32_t) terms, owner /* actor that writes */, allowed /* bit set: actors that may begin to */;
    _Atomic(uint64_t) lost; /* frames that superseded writers published in vain */
    struct term term[TERMS];
};

struct actor {
    _Atomic(uint64_t) beats; /* turns of its loop, as a sign of life */
    _Atomic(uint64_t) frames, missed, first, last;
    _Atomic(uint64_t) term;
    _Atomic(int64_t) term_time;      /* when the first frame of this term was seen */
    _Atomic(int64_t) longest;        /* between two frames, ns; the director sets it back */
    _Atomic(uint32_t) delay[DELAYS]; /* us from write to delivery of the last frames; frame n is at n % DELAYS */
    _Atomic(uint32_t) failed;
    char failure[160];
};

struct stage {
    struct ddx_fault_journal journal; /* the library's */
    struct stream stream[STREAMS];
    struct actor actor[ACTORS];
    _Atomic(uint32_t) failures;
};
extern struct stage *stage;

void stage_open(bool create);
void nap(double seconds);

/* actor.c: `kind` as below, on this stream; runs until TERM. `spoilt` names an intentional error. */
int actor_main(char kind, unsigned stream, unsigned index, double period);
/* writer.c */
/* vandal.c */
void play_vandal(struct actor *me, unsigned stream);
void play_flood(struct actor *me);
void play_writer(struct actor *me, unsigned stream, unsigned index, double period);
extern volatile int leaving;
extern const char *const stream_name[STREAMS];
void actor_fail(const char *format, ...) __attribute__((noreturn, format(printf, 1, 2)));
DDX_STORE_ITEM *actor_lookup(DDX_STORE_ID *id, const char *name);
bool later(int result); /* a temporary error, while a store or a writer is away or descriptors are short */

#endif
