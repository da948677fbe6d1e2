/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Live pictures: what a visitor asks for, and what `ddxvideosnap -answer` says. Both are checked here. */
#ifndef DDXPANEL_PICTURE_H
#define DDXPANEL_PICTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PICTURE_ITEM 63        /* bytes of an item's name */
#define PICTURE_MAX (1u << 20) /* bytes of a JPEG; several may be on their way to slow phones */
#define PICTURE_LINE 200u      /* bytes of a line of ddxvideosnap */
#define PICTURE_BEST 2         /* qualities as FFmpeg's q */
#define PICTURE_SMALLEST 31

struct picture_form {
    int quality;
    int divisor; /* of width and height: 1 or 2 */
};

struct picture_wanted {
    char item[PICTURE_ITEM + 1];
    uint64_t after; /* the frame that the visitor has; 0: none */
    struct picture_form form;
};

/*
 * Parse what follows "/panel/picture/": ITEM?after=N&quality=Q&divisor=D, where each of the three may be missing, and
 * the item may have %XX. False: it is something else, or no item can have this name.
 */
bool picture_parse(struct picture_wanted *wanted, const char *text);

enum picture_kind { PICTURE_NEW, PICTURE_NOTHING, PICTURE_REFUSED, PICTURE_TOO_LARGE };

struct picture_said {
    enum picture_kind kind;
    uint64_t sequence;  /* number of the frame in the store */
    int64_t frame;      /* in the source's count */
    int64_t age;        /* us */
    int64_t lost;       /* frames that the source has lost so far */
    size_t size;        /* bytes of JPEG that follow */
    const char *reason; /* of a refusal, in the line */
};

/* Parse a line of ddxvideosnap, without its line feed. False: it is none. A picture
 * that is larger than PICTURE_MAX is too large. */
bool picture_hear(struct picture_said *said, const char *line);

#endif
