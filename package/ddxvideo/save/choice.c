/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "choice.h"

#include <errno.h>
#include <stdbool.h>

static uint64_t common(uint64_t a, uint64_t b) {
    while (b) {
        uint64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

/* The fraction in lowest terms, or near it where these are larger than `most`. */
static void reduce(uint64_t *num, uint64_t *den, uint64_t most) {
    uint64_t divisor = common(*num, *den);
    *num /= divisor;
    *den /= divisor;
    while (*num > most || *den > most) {
        *num = (*num + 1) / 2;
        *den = (*den + 1) / 2;
    }
}

int choice_look(struct choice *choice, struct ddxvideo_geometry *geometry) {
    bool known = geometry->rate_num > 0 && geometry->rate_den > 0;
    uint64_t take = 1, of = choice->skip > 1 ? (uint64_t)choice->skip : 1;
    if (choice->rate_num && known) {
        uint64_t num = choice->rate_num, den = choice->rate_den; /* wanted, over theirs */
        uint64_t their_num = (uint64_t)geometry->rate_num, their_den = (uint64_t)geometry->rate_den;
        reduce(&num, &den, INT32_MAX);
        take = num * their_den;
        of = den * their_num;
        reduce(&take, &of, INT32_MAX);
    }
    choice->take = take < of ? (uint32_t)take : 0;
    choice->of = (uint32_t)of;
    if (known && choice->take) {
        uint64_t num = take * (uint64_t)geometry->rate_num, den = of * (uint64_t)geometry->rate_den;
        reduce(&num, &den, INT32_MAX);
        geometry->rate_num = (int)num;
        geometry->rate_den = (int)den;
    }
    return choice->rate_num && !known ? -ENODATA : 0;
}

uint64_t choice_up_to(const struct choice *choice, uint64_t sequence) {
    if (!choice->take)
        return sequence;
    /* sequence * take / of, rounded up: the first one is wanted, and nothing overflows. */
    uint64_t rest = sequence % choice->of * choice->take;
    return sequence / choice->of * choice->take + rest / choice->of + (rest % choice->of != 0);
}

uint64_t choice_wants(const struct choice *choice, uint64_t sequence, uint64_t frames) {
    if (!choice->take || frames > sequence) /* some of them had other numbers, which nobody knows */
        return frames;
    return choice_up_to(choice, sequence) - choice_up_to(choice, sequence - frames);
}
