/* SPDX-License-Identifier: GPL-2.0-or-later */
/* How much of a processor the encoding takes, and what gives way when that is too much. */
#ifndef DDXVIDEO_ENCODE_LOAD_H
#define DDXVIDEO_ENCODE_LOAD_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define ENCODE_LOAD_SECONDS 10
#define ENCODE_LOAD_MOST 80 /* %; above this, other programs get too little time */

/* All zeros at first. */
struct encode_load {
    _Atomic uint64_t spent;  /* ns of processor time */
    _Atomic uint32_t coarse; /* frames whose quality gave way */
    atomic_uint percent;     /* of one processor, over the last ENCODE_LOAD_SECONDS */
    /* private: */
    uint64_t spent_at[ENCODE_LOAD_SECONDS]; /* by second, the oldest at `at` */
    int64_t time_at[ENCODE_LOAD_SECONDS];
    unsigned at;
    bool lowered;  /* the thread's priority was real-time; now it is lower */
    bool ordinary; /* ... and now it is that of programs without one */
    int policy, priority;
};

/* Processor time of the calling thread so far, ns. */
int64_t encode_load_now(void);

/* Renew `percent`; to be called once a second, by one thread. */
void encode_load_measure(struct encode_load *load);

/*
 * For the thread that encodes, again and again: its real-time priority is one below the one that it inherited, so that
 * grabbers and loggers go first. While `percent` is too high, it has none: a recorder must not keep all other programs
 * from running. A frame that is missed then is lost in the store.
 */
void encode_load_yield(struct encode_load *load);

#endif
