/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "paint.h"

#include <errno.h>
#include <libavutil/pixfmt.h>
#include <libswscale/swscale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- Places ---- */

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

/* ---- Fields ---- */

#define VECTOR 32       /* pixels: a scaler fills rows up to a multiple of that */
#define CHROMA_SCALE 16 /* of chroma between samples */

/* One field of a picture. */
struct field {
    const uint8_t *plane[4];
    int stride[4];
    int width, height;
    bool full; /* range */
};

static struct field field_of(const struct ddxvideo_picture *picture, int number) {
    struct field field = {.width = picture->geometry.width,
                          .height = picture->geometry.height / picture->geometry.fields,
                          .full = picture->geometry.range == DDX_VIDEO_RANGE_FULL};

    for (int i = 0; i < 3; i++) {
        int row = i ? number * field.height / 2 : number * field.height;

        field.stride[i] = picture->stride[i];
        field.plane[i] = picture->plane[i] + (ptrdiff_t)row * picture->stride[i];
    }
    return field;
}

/* ---- Colours ---- */

static int clip(int value) {
    return value < 0 ? 0 : value > 255 ? 255 : value;
}

/* ITU-R BT.601, in 1/65536. */
struct matrix {
    int offset, gain, red, green_u, green_v, blue;
};
static const struct matrix limited = {16, 76309, 104597, 25675, 53279, 132201};
static const struct matrix whole = {0, 65536, 91881, 22554, 46802, 116130};

/* u and v in sixteenths, as colour_at() computes them. */
static uint32_t colour(const struct matrix *matrix, int y, int u, int v) {
    int luma = ((y - matrix->offset) * matrix->gain + 32768) * CHROMA_SCALE;
    int from_u = u - 128 * CHROMA_SCALE, from_v = v - 128 * CHROMA_SCALE;
    int red = clip((luma + matrix->red * from_v) >> 20);
    int green = clip((luma - matrix->green_u * from_u - matrix->green_v * from_v) >> 20);
    int blue = clip((luma + matrix->blue * from_u) >> 20);

    return (uint32_t)(red << 16 | green << 8 | blue);
}

/* A pixel's own row of chroma samples and the nearest other one, of both planes. */
struct chroma {
    const uint8_t *u, *v, *other_u, *other_v;
    int last; /* column */
};

static struct chroma chroma_of(const struct field *field, int row) {
    int own = row / 2, last = (field->height - 1) / 2;
    int other = row % 2 ? (own < last ? own + 1 : last) : (own > 0 ? own - 1 : 0);

    return (struct chroma){field->plane[1] + (ptrdiff_t)own * field->stride[1],
                           field->plane[2] + (ptrdiff_t)own * field->stride[2],
                           field->plane[1] + (ptrdiff_t)other * field->stride[1],
                           field->plane[2] + (ptrdiff_t)other * field->stride[2], (field->width - 1) / 2};
}

/* The pixel at `column`: a sample is in the middle of four pixels, so its weight is 3/4 in either direction. This keeps
   pixels within 1 of those of a snapshot, which libswscale makes with the same positions. */
static uint32_t colour_at(const struct matrix *matrix, const struct chroma *row, int column, int y) {
    int own = column / 2;
    int other = column % 2 ? (own < row->last ? own + 1 : own) : (own > 0 ? own - 1 : 0);
    int u = 9 * row->u[own] + 3 * (row->u[other] + row->other_u[own]) + row->other_u[other];
    int v = 9 * row->v[own] + 3 * (row->v[other] + row->other_v[own]) + row->other_v[other];

    return colour(matrix, y, u, v);
}

struct paint_pixel paint_look(const struct ddxvideo_picture *picture, int number, int column, int row) {
    struct field field = field_of(picture, number);
    struct chroma chroma = chroma_of(&field, row);
    struct paint_pixel pixel = {.y = field.plane[0][row * (ptrdiff_t)field.stride[0] + column],
                                .u = chroma.u[column / 2],
                                .v = chroma.v[column / 2]};
    uint32_t shown = colour_at(field.full ? &whole : &limited, &chroma, column, pixel.y);

    pixel.red = (int)(shown >> 16);
    pixel.green = (int)(shown >> 8 & 255);
    pixel.blue = (int)(shown & 255);
    return pixel;
}

/* ---- Places ---- */

/* Draws unchanged pixels, enlarged or not; only those on the canvas. */
static void copy(const struct canvas *canvas, const struct field *field, const struct layout_place *place) {
    const struct matrix *matrix = field->full ? &whole : &limited;
    int left = place->x < 0 ? 0 : place->x, right = place->x + place->width;
    int top = place->y < 0 ? 0 : place->y, below = place->y + place->height;

    right = right < canvas->width ? right : canvas->width;
    below = below < canvas->height ? below : canvas->height;
    for (int y = top, former = -1; y < below && left < right; y++) {
        int row = (int)((int64_t)(y - place->y) * field->height / place->height);
        uint32_t *to = canvas->pixel + (ptrdiff_t)y * canvas->stride;

        if (row == former) {
            memcpy(to + left, to + left - canvas->stride, (size_t)(right - left) * sizeof *to);
            continue;
        }
        former = row;
        const uint8_t *luma = field->plane[0] + (ptrdiff_t)row * field->stride[0];
        const struct chroma chroma = chroma_of(field, row);
        /* The column of a pixel without a division for each: column = at / place->width, counted along. */
        int64_t at = (int64_t)(left - place->x) * field->width;
        int column = (int)(at / place->width), rest = (int)(at % place->width);
        for (int x = left; x < right; x++) {
            to[x] = colour_at(matrix, &chroma, column, luma[column]);
            for (rest += field->width; rest >= place->width; rest -= place->width)
                column++;
        }
    }
}

static bool has_rows(struct painter *painter, size_t size) {
    if (painter->size >= size)
        return true;
    free(painter->rows);
    painter->rows = malloc(size);
    painter->size = painter->rows ? size : 0;
    return painter->rows;
}

static int scale(struct painter *painter, const struct canvas *canvas, const struct field *field,
                 const struct layout_place *place) {
    const int *matrix = sws_getCoefficients(SWS_CS_ITU601);
    int filled = (place->width + VECTOR - 1) / VECTOR * VECTOR;
    bool direct = place->x + filled <= canvas->stride; /* the margins are drawn later */
    struct SwsContext **scaler = &painter->scaler[place->field];

    /* Not AV_PIX_FMT_0RGB32: its scaler reports another format, and would be made again for each picture. */
    *scaler = sws_getCachedContext(*scaler, field->width, field->height, AV_PIX_FMT_YUV420P, place->width,
                                   place->height, AV_PIX_FMT_RGB32, SWS_BILINEAR, NULL, NULL, NULL);
    if (!*scaler || (!direct && !has_rows(painter, (size_t)filled * (size_t)place->height * sizeof *painter->rows)))
        return -ENOMEM;
    sws_setColorspaceDetails(*scaler, matrix, field->full, matrix, 1, 0, 1 << 16, 1 << 16);
    uint32_t *target = canvas->pixel + (ptrdiff_t)place->y * canvas->stride + place->x;
    uint8_t *to[4] = {(uint8_t *)(direct ? target : painter->rows)};
    const int stride[4] = {(direct ? canvas->stride : filled) * (int)sizeof *target};
    sws_scale(*scaler, field->plane, field->stride, 0, field->height, to, stride);
    for (int row = 0; row < place->height && !direct; row++)
        memcpy(target + (ptrdiff_t)row * canvas->stride, painter->rows + (ptrdiff_t)row * filled,
               (size_t)place->width * sizeof *target);
    return 0;
}

static bool is_exact(const struct canvas *canvas, const struct layout *layout, const struct layout_place *place) {
    return layout->exact || (place->width == layout->width && place->height == layout->height) || place->x < 0 ||
           place->y < 0 || place->x + place->width > canvas->width || place->y + place->height > canvas->height;
}

/* Fills the area beside the places. Called after them, since a scaler writes slightly beyond its place. */
static void fill_rest(const struct canvas *canvas, const struct layout *layout, uint32_t background) {
    for (int y = 0; y < canvas->height; y++) {
        int x = 0;

        while (x < canvas->width) {
            int next = canvas->width, beyond = x;

            for (int i = 0; i < layout->count; i++) {
                const struct layout_place *place = &layout->place[i];

                if (y < place->y || y >= place->y + place->height)
                    continue;
                if (place->x <= x && place->x + place->width > beyond)
                    beyond = place->x + place->width;
                else if (place->x > x && place->x < next)
                    next = place->x;
            }
            if (beyond > x) {
                x = beyond;
                continue;
            }
            for (uint32_t *row = canvas->pixel + (ptrdiff_t)y * canvas->stride; x < next; x++)
                row[x] = background;
        }
    }
}

int paint_fields(struct painter *painter, const struct canvas *canvas, const struct ddxvideo_picture *picture,
                 const struct layout *layout, uint32_t background) {
    int error = 0;

    for (int i = 0; i < layout->count && !error; i++) {
        const struct layout_place *place = &layout->place[i];
        const struct field field = field_of(picture, place->field);

        if (is_exact(canvas, layout, place))
            copy(canvas, &field, place);
        else
            error = scale(painter, canvas, &field, place);
    }
    fill_rest(canvas, layout, background);
    return error;
}

void paint_close(struct painter *painter) {
    for (int i = 0; i < DDX_VIDEO_FIELDS; i++)
        sws_freeContext(painter->scaler[i]);
    free(painter->rows);
    *painter = (struct painter){0};
}

/* ---- Parts ---- */

struct canvas paint_part(const struct canvas *canvas, int x, int y, int width, int height) {
    int left = x < 0 ? 0 : x > canvas->width ? canvas->width : x;
    int top = y < 0 ? 0 : y > canvas->height ? canvas->height : y;
    int right = x + width < left ? left : x + width > canvas->width ? canvas->width : x + width;
    int below = y + height < top ? top : y + height > canvas->height ? canvas->height : y + height;

    return (struct canvas){canvas->pixel + (ptrdiff_t)top * canvas->stride + left, canvas->stride, right - left,
                           below - top};
}

void paint_all(const struct canvas *canvas, uint32_t colour) {
    for (int y = 0; y < canvas->height; y++)
        for (int x = 0; x < canvas->width; x++)
            canvas->pixel[(ptrdiff_t)y * canvas->stride + x] = colour;
}

void paint_grey(const struct canvas *canvas) {
    for (int y = 0; y < canvas->height; y++) {
        uint32_t *row = canvas->pixel + (ptrdiff_t)y * canvas->stride;

        for (int x = 0; x < canvas->width; x++) {
            uint32_t grey = ((row[x] >> 16 & 255) * 77 + (row[x] >> 8 & 255) * 150 + (row[x] & 255) * 29) >> 9;

            row[x] = grey << 16 | grey << 8 | grey;
        }
    }
}
