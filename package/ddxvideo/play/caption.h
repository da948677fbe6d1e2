/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The text below the picture: the frame, and what is missing. */
#ifndef DDXVIDEO_PLAY_CAPTION_H
#define DDXVIDEO_PLAY_CAPTION_H

#include "surface.h"
#include "watch.h"

struct caption_facts {
    const char *name; /* of the item */
    bool shown;       /* a picture is on display: */
    int frame;        /* its number */
    double rate;      /* frames a second, 0 if unknown */
    int64_t age;      /* of the picture, ns since its capture */
    struct watch_view writer;
    const char *missing; /* missing now; NULL: nothing */
    int64_t since;       /* ns since it is missing */
    bool stale;          /* the picture is old */
};

struct caption {
    char line[2][128]; /* an empty line is left out */
};

/* Write the lines. `wanted`: with the first one. The second one is written whenever something is missing. */
struct caption caption_make(const struct caption_facts *facts, bool wanted);

void caption_draw(const struct caption *caption, const struct canvas *canvas);

#endif
