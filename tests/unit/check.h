/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The whole test framework: a check that fails says where and ends the program. Exit 0 passed, 1 failed, 77 skipped. */
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

/* Compare two integers and show both. */
#define CHECK_EQUAL(actual, expected)                                                                              \
    do {                                                                                                           \
        long long actual_ = (long long)(actual), expected_ = (long long)(expected);                                \
        if (actual_ != expected_) {                                                                                \
            fprintf(stderr, "%s:%d: %s is %lld, not %lld (%s)\n", __FILE__, __LINE__, #actual, actual_, expected_, \
                    #expected);                                                                                    \
            exit(1);                                                                                               \
        }                                                                                                          \
    } while (0)

/* Skip the test. The reason is its last output, which the results of a run quote. */
#define SKIP(reason)                     \
    do {                                 \
        fprintf(stderr, "%s\n", reason); \
        exit(77);                        \
    } while (0)

#endif
