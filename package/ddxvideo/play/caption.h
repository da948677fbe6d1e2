/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What stands below the picture: which frame it is, and what is missing. */
#ifndef DDXVIDEO_PLAY_CAPTION_H
#define DDXVIDEO_PLAY_CAPTION_H

#include "surface.h"
#include "watch.h"

struct caption_facts {
    const char *name; /* of the item */
    bool shown;       /* there is a picture: */
    int frame;        /* its number */
    double rate;      /* frames a second, 0 if unknown */
    int64_t age;      /* of the picture, ns since its capture */
    struct watch_view writer;
    const char *missing; /* NULL: nothing */
    int64_t since;       /* ns that it has been missing */
    bool stale;          /* the picture is not what is now */
};

struct caption {
    char line[2][128]; /* an empty one is left out */
};

/* `wanted`: the first line, too; the second one is always there while something is missing. */
struct caption caption_make(const struct caption_facts *facts, bool wanted);

void caption_draw(const struct caption *caption, const struct canvas *canvas);

#endif
