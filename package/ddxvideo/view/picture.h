/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The window's content. */
#ifndef DDXVIDEO_PICTURE_H
#define DDXVIDEO_PICTURE_H

#include "view.h"

/* Draw everything. False, after a line, if the surface is gone. */
bool picture_draw(struct view *view);

/* The same, on a canvas. */
void picture_paint(struct view *view, const struct canvas *canvas);

/* The size of a window for a picture of this kind, with the status below it. */
void picture_size(const struct ddxvideo_geometry *geometry, int *width, int *height);

#endif
