/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The three lines below the pictures. */
#ifndef DDXVIDEO_STATUS_H
#define DDXVIDEO_STATUS_H

#include "view.h"

#define STATUS_MAX 300

struct status {
    const char *label; /* LIVE, PAUSED, ... */
    uint32_t colour, ink;
    char name[STATUS_MAX], gap[80], facts[STATUS_MAX], rest[STATUS_MAX];
};

/* Write the lines. `layout`: as drawn, zoomed; NULL: nothing is drawn. */
void status_compose(struct status *status, struct view *view, const struct layout *layout);

#endif
