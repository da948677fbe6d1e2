/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The whole test framework: a failed check prints its place and exits. Exit status: 0 passed, 1 failed, 77 skipped,
 * FRAMES_BROKEN: frames were torn or lost, so that the test fails even if a second run passes. */
#ifndef CHECK_H
#define CHECK_H

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                              \
    do {                                                                              \
        if (!(condition)) {                                                           \
            fprintf(stderr, "%s:%d: not true: %s\n", __FILE__, __LINE__, #condition); \
            exit(1);                                                                  \
        }                                                                             \
    } while (0)

#define FRAMES_BROKEN 3

/* Compare two integers, and print both if they differ. */
#define CHECK_EQUAL(actual, expected)                                                                              \
    do {                                                                                                           \
        long long actual_ = (long long)(actual), expected_ = (long long)(expected);                                \
        if (actual_ != expected_) {                                                                                \
            fprintf(stderr, "%s:%d: %s is %lld, not %lld (%s)\n", __FILE__, __LINE__, #actual, actual_, expected_, \
                    #expected);                                                                                    \
            exit(1);                                                                                               \
        }                                                                                                          \
    } while (0)

/* Frames that are torn, lost or out of order. */
#define CHECK_NO_FRAMES(count)                                                                   \
    do {                                                                                         \
        if (count) {                                                                             \
            fprintf(stderr, "%s:%d: %s is %u\n", __FILE__, __LINE__, #count, (unsigned)(count)); \
            exit(FRAMES_BROKEN);                                                                 \
        }                                                                                        \
    } while (0)

/* Skip the test. Its last line of output is the reason, which the results of a run quote. */
#define SKIP(reason)                     \
    do {                                 \
        fprintf(stderr, "%s\n", reason); \
        exit(77);                        \
    } while (0)

#endif
