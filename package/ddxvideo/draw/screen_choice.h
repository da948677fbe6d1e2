/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Which screen to use, and its mode. */
#ifndef DDXVIDEO_SCREEN_CHOICE_H
#define DDXVIDEO_SCREEN_CHOICE_H

#include <stdbool.h>

struct screen_choice {
    const char *output; /* a connector's name, such as "HDMI-A-1"; NULL: the first with a monitor */
    int width, height;  /* of the mode, pixels; 0: the mode that the monitor prefers */
    bool keys;          /* report keys of the terminal on standard input as events */
};

#endif
