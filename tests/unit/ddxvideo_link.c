/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The line of ddxdecode about the link. */
#include "link.h"

#include <string.h>

#include "check.h"

#define MS INT64_C(1000000)

int main(void) {
    struct link link = {0};
    uint64_t figures[LINK_COUNTS] = {0};
    char text[LINK_TEXT_MAX];
    int64_t now = 1000 * 1000 * MS, begin = now;

    for (unsigned i = 0; i < 50; i++, now += 40 * MS) { /* 25 a second: 600 bytes of video, 300 of repair */
        link_packet(&link, false, 600, now);
        link_packet(&link, true, 300, now);
        link_shown(&link, !i, now);
    }
    link_figures(&link, now, figures);
    CHECK(figures[LINK_VIDEO] >= 115 && figures[LINK_VIDEO] <= 125);
    CHECK(figures[LINK_REPAIR] >= 57 && figures[LINK_REPAIR] <= 63);
    CHECK_EQUAL(figures[LINK_FREEZE], 40);

    now += 460 * MS;
    link_shown(&link, false, now); /* 500 ms after the last one */
    link_figures(&link, now, figures);
    CHECK_EQUAL(figures[LINK_FREEZE], 500);
    CHECK(!link_says(&link, now, figures, text));
    now = begin + 61 * 1000 * MS;
    link_shown(&link, true, now); /* another source: not a freeze */
    link_figures(&link, now, figures);
    CHECK_EQUAL(figures[LINK_FREEZE], 500);
    figures[LINK_LOSS] = 30;
    figures[LINK_RUN] = 14;
    CHECK(!link_says(&link, now, figures, text)); /* a minute after the first call */
    now += 3000 * MS;
    CHECK(link_says(&link, now, figures, text) && !link_says(&link, now, figures, text));
    CHECK(!strcmp(text, "loss 30 %, runs of 1.4 packets, video 0 kbit/s, repair 0 kbit/s, longest freeze of the last "
                        "minute 500 ms"));
    link_figures(&link, now, figures);
    CHECK_EQUAL(figures[LINK_FREEZE], 0); /* more than a minute ago */
    return 0;
}
