/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "montage.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "text.h"

#define INK 0xe0e0e0
#define LINE (TEXT_CELL_HEIGHT + 2)

/* A picture's shape in pixels that are square. */
static void square(const struct ddxvideo_geometry *picture, int *width, int *height) {
    *width = picture->width;
    *height = picture->height;
    if (picture->aspect_num > 0 && picture->aspect_den > 0) {
        int64_t wide = (int64_t)picture->width * picture->aspect_num / picture->aspect_den;

        if (wide > 0 && wide <= DDX_VIDEO_SIDE)
            *width = (int)wide;
    }
}

/* The largest size of this shape that fits. */
static void fit(int64_t width, int64_t height, struct montage_place *place) {
    if (width * place->height >= height * place->width) {
        height = height * place->width / width;
        width = place->width;
    } else {
        width = width * place->height / height;
        height = place->height;
    }
    place->x += (int)(place->width - width) / 2;
    place->y += (int)(place->height - height) / 2;
    place->width = width > 0 ? (int)width : 1;
    place->height = height > 0 ? (int)height : 1;
}

void montage_plan(const struct ddxvideo_geometry *pictures, unsigned count, struct montage_place *places, int *width,
                  int *height) {
    int columns = 1, cell_width = 1, cell_height = 1;

    while ((unsigned)(columns * columns) < count)
        columns++;
    int rows = ((int)count + columns - 1) / columns;
    for (unsigned i = 0; i < count; i++) {
        int wide, high;

        square(&pictures[i], &wide, &high);
        cell_width = wide > cell_width ? wide : cell_width;
        cell_height = high > cell_height ? high : cell_height;
    }
    while (cell_width * columns > MONTAGE_SIDE ||
           (cell_height + LINE * text_scale(cell_height)) * rows > MONTAGE_SIDE) {
        cell_width = cell_width > 1 ? cell_width / 2 : 1;
        cell_height = cell_height > 1 ? cell_height / 2 : 1;
    }
    int scale = text_scale(cell_height), line = LINE * scale;
    *width = cell_width * columns;
    *height = (cell_height + line) * rows;
    for (unsigned i = 0; i < count; i++) {
        int wide, high;

        square(&pictures[i], &wide, &high);
        int x = (int)i % columns * cell_width, y = (int)i / columns * (cell_height + line);
        places[i] = (struct montage_place){x, y, cell_width, cell_height, x + cell_width, scale};
        fit(wide, high, &places[i]);
    }
}

int montage_caption(AVFrame *image, const struct montage_place *place, const char *text) {
    struct canvas canvas = {NULL, place->right - place->x, place->right - place->x, LINE * place->scale};
    int top = place->y + place->height;

    canvas.pixel = calloc((size_t)canvas.width * (size_t)canvas.height, sizeof *canvas.pixel);
    if (!canvas.pixel)
        return -ENOMEM;
    text_write(&canvas, 0, place->scale, place->scale, INK, text);
    for (int y = 0; y < canvas.height; y++) {
        uint8_t *to = image->data[0] + (ptrdiff_t)(top + y) * image->linesize[0] + 3 * (ptrdiff_t)place->x;

        for (int x = 0; x < canvas.width; x++)
            memset(to + 3 * x, (int)(canvas.pixel[y * canvas.width + x] & 255), 3);
    }
    free(canvas.pixel);
    return 0;
}
