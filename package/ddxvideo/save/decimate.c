/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decimate.h"

#include <errno.h>
#include <stdbool.h>

#include "fraction.h"

/* Chooses `take` and `of`, and the rate of the recorded frames. */
static void choose(struct decimate *decimate, bool known) {
    int64_t take = 1, of = decimate->skip > 1 ? decimate->skip : 1;

    if (decimate->rate_num && known) {
        int64_t num = decimate->rate_num, den = decimate->rate_den; /* wanted rate / actual rate */

        fraction_reduce(&num, &den);
        take = num * decimate->their_den;
        of = den * decimate->their_num;
        fraction_reduce(&take, &of);
    }
    decimate->take = take < of ? (uint32_t)take : 0;
    decimate->of = (uint32_t)of;
    decimate->kept_num = decimate->their_num;
    decimate->kept_den = decimate->their_den;
    if (known && decimate->take)
        fraction_set(&decimate->kept_num, &decimate->kept_den, take * decimate->their_num, of * decimate->their_den);
}

int decimate_look(struct decimate *decimate, struct ddxvideo_geometry *geometry) {
    bool known = geometry->rate_num > 0 && geometry->rate_den > 0;

    if (!decimate->of || geometry->rate_num != decimate->their_num || geometry->rate_den != decimate->their_den) {
        decimate->their_num = geometry->rate_num;
        decimate->their_den = geometry->rate_den;
        choose(decimate, known);
    }
    geometry->rate_num = decimate->kept_num;
    geometry->rate_den = decimate->kept_den;
    return decimate->rate_num && !known ? -ENODATA : 0;
}

uint64_t decimate_up_to(const struct decimate *decimate, uint64_t sequence) {
    if (!decimate->take)
        return sequence;
    /* sequence * take / of, rounded up, so that the first frame is wanted; without overflow. */
    uint64_t rest = sequence % decimate->of * decimate->take;
    return sequence / decimate->of * decimate->take + rest / decimate->of + (rest % decimate->of != 0);
}

uint64_t decimate_wants(const struct decimate *decimate, uint64_t sequence, uint64_t frames) {
    if (!decimate->take || frames > sequence) /* some of them had other, unknown numbers */
        return frames;
    return decimate_up_to(decimate, sequence) - decimate_up_to(decimate, sequence - frames);
}
