/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The link's figures for the operator: rates of the last second, and how long the picture stood still in the last
 * minute. No clock: time is a parameter (CLOCK_MONOTONIC, ns). */
#ifndef DDXVIDEO_LINK_H
#define DDXVIDEO_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LINK_SECONDS 60

enum link_count { LINK_VIDEO, LINK_REPAIR, LINK_LOSS, LINK_RUN, LINK_FREEZE, LINK_COUNTS };
#define LINK_NAMES "video_kbit", "repair_kbit", "loss_percent", "run_tenths", "freeze_ms"
#define LINK_TEXT_MAX 160

struct link {
    int64_t begin;                 /* of this second */
    uint64_t bytes[2];             /* that came in it, media and repair packets */
    uint64_t kbit[2];              /* of the last whole second */
    int64_t shown;                 /* time of the last picture, 0: none of this source */
    int64_t second;                /* the newest one of: */
    int64_t longest[LINK_SECONDS]; /* ns from a picture to the one before it, by second */
    int64_t said;
};

/* Count a packet. */
void link_packet(struct link *link, bool repair, size_t size, int64_t now);

/* A picture was shown; with `first` it is the first one of its source. */
void link_shown(struct link *link, bool first, int64_t now);

/* Set LINK_VIDEO, LINK_REPAIR and LINK_FREEZE of the figures. */
void link_figures(struct link *link, int64_t now, uint64_t figures[LINK_COUNTS]);

/* Once a minute, if packets are lost or the picture stood still: true, and a line with all figures. */
bool link_says(struct link *link, int64_t now, const uint64_t figures[LINK_COUNTS], char text[LINK_TEXT_MAX]);

#endif
