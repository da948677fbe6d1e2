/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "rectifier.h"

#include <math.h>
#include <stdlib.h>

#define PARTS 32 /* of a pixel, as in OpenCV's tables */
#define OUTSIDE (-1)

/* The upper left of four pixels, and the shares of the pixels to its right and below it, of PARTS. */
struct place {
    int16_t x, y;
    uint8_t right, below;
};

struct rectifier {
    int width, height;
    struct place place[];
};

/* The inverse of a 3x3 matrix. */
static void invert(const double m[9], double to[9]) {
    double a = m[4] * m[8] - m[5] * m[7], b = m[5] * m[6] - m[3] * m[8], c = m[3] * m[7] - m[4] * m[6];
    double determinant = m[0] * a + m[1] * b + m[2] * c;
    const double adjugate[9] = {a, m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                                b, m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                                c, m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};

    for (int i = 0; i < 9; i++)
        to[i] = adjugate[i] / determinant;
}

/* From pixels of the rectified picture to rays of the camera: the inverse of projection * rotation. */
static void rays_of(const struct calibration *calibration, enum eye eye, double rays[9]) {
    const double *r = calibration->eye[eye].rotation, *p = calibration->eye[LEFT].projection;
    double product[9];

    for (int i = 0; i < 9; i++) {
        int row = i / 3 * 4, column = i % 3;
        product[i] = p[row] * r[column] + p[row + 1] * r[3 + column] + p[row + 2] * r[6 + column];
    }
    invert(product, rays);
}

/* The camera's pixel for the point (x, y) at distance 1. */
static void see(const struct calibration_eye *eye, double x, double y, double *u, double *v) {
    const double *k = eye->distortion, *m = eye->camera;
    double xx = x * x, yy = y * y, r2 = xx + yy, xy = 2 * x * y;
    double stretch = (1 + ((k[4] * r2 + k[1]) * r2 + k[0]) * r2) / (1 + ((k[7] * r2 + k[6]) * r2 + k[5]) * r2);
    double at_x = x * stretch + k[2] * xy + k[3] * (r2 + 2 * xx) + (k[8] + k[9] * r2) * r2;
    double at_y = y * stretch + k[2] * (r2 + 2 * yy) + k[3] * xy + (k[10] + k[11] * r2) * r2;

    *u = m[0] * at_x + m[1] * at_y + m[2];
    *v = m[4] * at_y + m[5];
}

/* The first of two neighbours along an axis of `count` pixels, and the share of the second; OUTSIDE: none. */
static int16_t neighbour(double at, int count, uint8_t *share) {
    if (!(at > -1 && at < count))
        return OUTSIDE;
    long parts = lrint(at * PARTS), first = parts / PARTS;
    if (parts < 0 || parts > (long)(count - 1) * PARTS)
        return OUTSIDE;
    first -= first == count - 1; /* the last pixel is the second neighbour, and has the whole share */
    *share = (uint8_t)(parts - first * PARTS);
    return (int16_t)first;
}

struct rectifier *rectifier_new(const struct calibration *calibration, enum eye eye, int width, int height) {
    size_t pixels = (size_t)width * (size_t)height;
    struct rectifier *rectifier = malloc(sizeof *rectifier + pixels * sizeof *rectifier->place);
    double rays[9];

    if (!rectifier)
        return NULL;
    rectifier->width = width;
    rectifier->height = height;
    rays_of(calibration, eye, rays);
    for (size_t i = 0; i < pixels; i++) {
        struct place *place = &rectifier->place[i];
        double x = (double)(i % (size_t)width), y = (double)(i / (size_t)width), u, v;
        double depth = rays[6] * x + rays[7] * y + rays[8];

        see(&calibration->eye[eye], (rays[0] * x + rays[1] * y + rays[2]) / depth,
            (rays[3] * x + rays[4] * y + rays[5]) / depth, &u, &v);
        place->x = depth > 0 ? neighbour(u, width, &place->right) : OUTSIDE;
        place->y = neighbour(v, height, &place->below);
        if (place->y == OUTSIDE)
            place->x = OUTSIDE;
    }
    return rectifier;
}

void rectifier_free(struct rectifier *rectifier) {
    free(rectifier);
}

void rectifier_run(const struct rectifier *rectifier, const uint8_t *from, long from_stride, const uint8_t level[256],
                   uint8_t *to, long to_stride) {
    const struct place *place = rectifier->place;

    for (int y = 0; y < rectifier->height; y++, to += to_stride)
        for (int x = 0; x < rectifier->width; x++, place++) {
            if (place->x == OUTSIDE) {
                to[x] = 0;
                continue;
            }
            const uint8_t *above = from + place->y * from_stride + place->x, *below = above + from_stride;
            unsigned right = place->right, down = place->below, left = PARTS - right;
            unsigned sum = (above[0] * left + above[1] * right) * (PARTS - down) +
                           (below[0] * left + below[1] * right) * down;

            to[x] = level[(sum + PARTS * PARTS / 2) / (PARTS * PARTS)];
        }
}
