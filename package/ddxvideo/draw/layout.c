/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "layout.h"

#include <math.h>

void layout_square(const struct ddxvideo_geometry *geometry, double *width, double *height) {
    *width = geometry->width;
    *height = (double)geometry->height / geometry->fields;
    if (geometry->aspect_num > 0 && geometry->aspect_den > 0)
        *width *= (double)geometry->aspect_num / geometry->aspect_den;
    if (*width > DDX_VIDEO_SIDE * 16.0) /* beyond the aspect of any camera */
        *width = DDX_VIDEO_SIDE * 16.0;
}

static double smaller(double a, double b) {
    return a < b ? a : b;
}

/* The number of fields side by side that makes them largest; of several such numbers the smallest. */
static int columns_of(int count, double wide, double high, int width, int height) {
    double best = 0;
    int columns = 1;

    for (int c = 1; c <= count; c++) {
        int rows = (count + c - 1) / c;
        double scale = smaller(width / (c * wide), height / (rows * high));

        if (scale > best * 1.0001) {
            best = scale;
            columns = c;
        }
    }
    return columns;
}

static int at_least_1(double value) {
    return value < 1 ? 1 : (int)value;
}

void layout_fields(struct layout *layout, const struct ddxvideo_geometry *geometry, int field, enum layout_fit fit,
                   int width, int height) {
    double wide, high;

    layout_square(geometry, &wide, &high);
    *layout = (struct layout){
        .width = geometry->width, .height = geometry->height / geometry->fields, .exact = fit == LAYOUT_PIXELS};
    layout->count = field == LAYOUT_ALL ? geometry->fields : 1;
    if (fit == LAYOUT_PIXELS) {
        wide = layout->width;
        high = layout->height;
    }
    int columns = columns_of(layout->count, wide, high, width, height);
    int rows = (layout->count + columns - 1) / columns;
    double scale = smaller(width / (columns * wide), height / (rows * high));
    double across = fit == LAYOUT_PIXELS ? 1 : fit == LAYOUT_FILL ? width / (columns * wide) : scale;
    double down = fit == LAYOUT_PIXELS ? 1 : fit == LAYOUT_FILL ? height / (rows * high) : scale;
    int place_width = at_least_1(wide * across + 1e-6), place_height = at_least_1(high * down + 1e-6);
    int left = (width - columns * place_width) / 2, top = (height - rows * place_height) / 2;

    for (int i = 0; i < layout->count; i++)
        layout->place[i] = (struct layout_place){i, left + i % columns * place_width, top + i / columns * place_height,
                                                 place_width, place_height};
    if (field != LAYOUT_ALL)
        layout->place[0].field = field < geometry->fields ? field : geometry->fields - 1;
}

void layout_zoom(struct layout *layout, const struct layout_view *view) {
    layout->exact |= view->zoom > 1;
    for (int i = 0; i < layout->count; i++) {
        struct layout_place *place = &layout->place[i];
        int right = (int)lround((place->x + place->width) * view->zoom + view->x);
        int below = (int)lround((place->y + place->height) * view->zoom + view->y);

        place->x = (int)lround(place->x * view->zoom + view->x);
        place->y = (int)lround(place->y * view->zoom + view->y);
        place->width = right > place->x ? right - place->x : 1;
        place->height = below > place->y ? below - place->y : 1;
    }
}

void layout_zoom_at(const struct layout *layout, struct layout_view *view, double factor, int x, int y) {
    double most = (double)LAYOUT_LARGEST * layout->width / layout->place[0].width, zoom = view->zoom * factor;

    if (zoom > most)
        zoom = most;
    if (zoom <= 1.0001) {
        *view = (struct layout_view){1, 0, 0};
        return;
    }
    /* Keeps the middle of the pixel in its place: with its edge, rounding could lead to the next pixel. */
    view->x = x + 0.5 - (x + 0.5 - view->x) * zoom / view->zoom;
    view->y = y + 0.5 - (y + 0.5 - view->y) * zoom / view->zoom;
    view->zoom = zoom;
}

bool layout_at(const struct layout *layout, int x, int y, int *field, int *column, int *row) {
    for (int i = 0; i < layout->count; i++) {
        const struct layout_place *place = &layout->place[i];

        if (x < place->x || y < place->y || x >= place->x + place->width || y >= place->y + place->height)
            continue;
        *field = place->field;
        *column = (int)((int64_t)(x - place->x) * layout->width / place->width);
        *row = (int)((int64_t)(y - place->y) * layout->height / place->height);
        return true;
    }
    return false;
}
