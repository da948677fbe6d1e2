/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "picture_size.h"

#include <ddxvideo.h>
#include <strings.h>

static const struct {
    const char *name;
    int width, height;
} names[] = {
    {"QCIF", 176, 144}, {"CIF", 352, 288},  {"4CIF", 704, 576},  {"VGA", 640, 480},
    {"PAL", 720, 576},  {"NTSC", 720, 480}, {"720p", 1280, 720}, {"1080p", 1920, 1080},
};

/* Reads digits up to `end`; 0: anything else, or too large. */
static int side(const char **text, char end) {
    int value = 0;

    while (**text >= '0' && **text <= '9' && value <= DDX_VIDEO_SIDE)
        value = value * 10 + *(*text)++ - '0';
    return **text == end && value <= DDX_VIDEO_SIDE && value % 2 == 0 ? value : 0;
}

bool size_parse(const char *text, int *width, int *height) {
    for (unsigned i = 0; i < sizeof names / sizeof *names; i++) {
        if (!strcasecmp(text, names[i].name)) {
            *width = names[i].width;
            *height = names[i].height;
            return true;
        }
    }
    int w = side(&text, 'x');
    if (!w)
        return false;
    text++;
    int h = side(&text, '\0');
    if (!h)
        return false;
    *width = w;
    *height = h;
    return true;
}
