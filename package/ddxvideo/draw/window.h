/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A window as a surface. SDL2 is loaded at run time, so that a machine without a screen does not need it. */
#ifndef DDXVIDEO_WINDOW_H
#define DDXVIDEO_WINDOW_H

#include "surface.h"

/*
 * Open a window, which is visible from the first surface_resize() on. It is the caller's until surface_close(); a
 * program has one at a time. NULL, with the reason in *error as a static text.
 */
struct surface *window_open(const char *title, const char **error);

#endif
