/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Text on a canvas, in a small bitmap font: ASCII, each character in a cell of the same size. */
#ifndef DDXVIDEO_TEXT_H
#define DDXVIDEO_TEXT_H

#include <stddef.h>

#include "surface.h"

#define TEXT_CELL_WIDTH 6 /* pixels of the canvas, times the scale */
#define TEXT_CELL_HEIGHT 10

/* The scale at which text is legible on a canvas of this height: 1, 2, 3 ... */
int text_scale(int height);

/*
 * Write text from the left, and cut off the rest where it does not fit. A character that is not printable ASCII is
 * written as '?'. A line feed begins a new line. The background stays.
 */
void text_write(const struct canvas *canvas, int x, int y, int scale, uint32_t colour, const char *text);

/* Append to a text in `size` bytes of memory; the rest is cut off where it does not fit. */
__attribute__((format(printf, 3, 4))) void text_append(char *text, size_t size, const char *format, ...);

#endif
