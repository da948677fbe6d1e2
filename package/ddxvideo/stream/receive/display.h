/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The window of decode, with the latest picture. */
#ifndef DDXVIDEO_DISPLAY_H
#define DDXVIDEO_DISPLAY_H

#include <libavutil/frame.h>
#include <stdbool.h>

struct display;

/* NULL, with the reason in *error. */
struct display *display_open(const char *title, const char **error);
void display_close(struct display *display);

/* Show a picture. NULL, or the reason of a failure. */
const char *display_show(struct display *display, const AVFrame *picture);

/* False if the window was closed, or Escape or q was pressed. Call it often. */
bool display_tick(struct display *display);

#endif
