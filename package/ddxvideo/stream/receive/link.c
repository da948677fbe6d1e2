/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "link.h"

#include <inttypes.h>
#include <stdio.h>

#include "ddx_time.h"

#define STILL_MS 400 /* a picture that stands still for longer is worth a line */

static void measure(struct link *link, int64_t now) {
    int64_t passed = now - link->begin;

    if (passed < SECOND)
        return;
    for (unsigned i = 0; i < 2; i++) {
        link->kbit[i] = passed < 2 * SECOND ? link->bytes[i] * 8 * 1000000 / (uint64_t)passed : 0;
        link->bytes[i] = 0;
    }
    link->begin = now;
}

void link_packet(struct link *link, bool repair, size_t size, int64_t now) {
    measure(link, now);
    link->bytes[repair] += size;
}

/* Forgets what is older than a minute. */
static void pass(struct link *link, int64_t now) {
    int64_t second = now / SECOND;

    if (second - link->second > LINK_SECONDS)
        link->second = second - LINK_SECONDS;
    while (link->second < second)
        link->longest[++link->second % LINK_SECONDS] = 0;
}

void link_shown(struct link *link, bool first, int64_t now) {
    pass(link, now);
    int64_t *longest = &link->longest[link->second % LINK_SECONDS];

    if (!first && link->shown && now - link->shown > *longest)
        *longest = now - link->shown;
    link->shown = now;
}

void link_figures(struct link *link, int64_t now, uint64_t figures[LINK_COUNTS]) {
    int64_t longest = 0;

    measure(link, now);
    pass(link, now);
    for (unsigned i = 0; i < LINK_SECONDS; i++)
        longest = link->longest[i] > longest ? link->longest[i] : longest;
    figures[LINK_VIDEO] = link->kbit[0];
    figures[LINK_REPAIR] = link->kbit[1];
    figures[LINK_FREEZE] = (uint64_t)(longest / MS);
}

bool link_says(struct link *link, int64_t now, const uint64_t figures[LINK_COUNTS], char text[LINK_TEXT_MAX]) {
    if (!link->said)
        link->said = now;
    if (now - link->said < LINK_SECONDS * SECOND || (!figures[LINK_LOSS] && figures[LINK_FREEZE] < STILL_MS))
        return false;
    link->said = now;
    snprintf(text, LINK_TEXT_MAX,
             "loss %" PRIu64 " %%, runs of %" PRIu64 ".%" PRIu64 " packets, video %" PRIu64 " kbit/s, repair %" PRIu64
             " kbit/s, longest freeze of the last minute %" PRIu64 " ms",
             figures[LINK_LOSS], figures[LINK_RUN] / 10, figures[LINK_RUN] % 10, figures[LINK_VIDEO],
             figures[LINK_REPAIR], figures[LINK_FREEZE]);
    return true;
}
