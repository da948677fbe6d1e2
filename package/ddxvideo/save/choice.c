/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "choice.h"

#include <errno.h>
#include <stdbool.h>

#include "fraction.h"

/* What to take of pictures at their rate, if that is known, and at what rate these come then. */
static void choose(struct choice *choice, bool known) {
    int64_t take = 1, of = choice->skip > 1 ? choice->skip : 1;

    if (choice->rate_num && known) {
        int64_t num = choice->rate_num, den = choice->rate_den; /* wanted, over theirs */

        fraction_reduce(&num, &den);
        take = num * choice->their_den;
        of = den * choice->their_num;
        fraction_reduce(&take, &of);
    }
    choice->take = take < of ? (uint32_t)take : 0;
    choice->of = (uint32_t)of;
    choice->kept_num = choice->their_num;
    choice->kept_den = choice->their_den;
    if (known && choice->take)
        fraction_set(&choice->kept_num, &choice->kept_den, take * choice->their_num, of * choice->their_den);
}

int choice_look(struct choice *choice, struct ddxvideo_geometry *geometry) {
    bool known = geometry->rate_num > 0 && geometry->rate_den > 0;

    if (!choice->of || geometry->rate_num != choice->their_num || geometry->rate_den != choice->their_den) {
        choice->their_num = geometry->rate_num;
        choice->their_den = geometry->rate_den;
        choose(choice, known);
    }
    geometry->rate_num = choice->kept_num;
    geometry->rate_den = choice->kept_den;
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
    if (!choice->take || frames > sequence) /* some of them had other, unknown numbers */
        return frames;
    return choice_up_to(choice, sequence) - choice_up_to(choice, sequence - frames);
}
