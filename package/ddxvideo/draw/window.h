/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A window as a surface. SDL2 is looked for at run time, so that a machine without a screen needs none of it. */
#ifndef DDXVIDEO_WINDOW_H
#define DDXVIDEO_WINDOW_H

#include "surface.h"

/*
 * A window, which is seen from the first surface_resize() on. The caller's, until surface_close(). NULL, and what is
 * missing in *error, as a static text. One at a time.
 */
struct surface *window_open(const char *title, const char **error);

#endif
