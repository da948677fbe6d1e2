/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "geometry.h"

static int64_t common(int64_t a, int64_t b) {
    while (b) {
        int64_t rest = a % b;
        a = b;
        b = rest;
    }
    return a;
}

/* Reduced; what does not fit then is halved until it does, which changes the eighth digit. */
static void set(int *num, int *den, int64_t n, int64_t d) {
    int64_t divisor = n && d ? common(n, d) : 1;
    n /= divisor;
    d /= divisor;
    while (n > INT32_MAX || d > INT32_MAX) {
        n = (n + 1) / 2;
        d = (d + 1) / 2;
    }
    *num = (int)n;
    *den = (int)d;
}

void geometry_reduce(int *num, int *den) {
    set(num, den, *num, *den);
}

void geometry_scale_aspect(struct ddxvideo_geometry *geometry, int width, int height) {
    if (!geometry->aspect_num)
        return;
    geometry_reduce(&width, &height);
    int64_t num = (int64_t)geometry->aspect_num * width, den = (int64_t)geometry->aspect_den * height;
    int64_t divisor = common(num, den);
    set(&geometry->aspect_num, &geometry->aspect_den, num / divisor * geometry->height,
        den / divisor * geometry->width);
}

struct ddxvideo_geometry geometry_of_result(const struct ddxvideo_geometry *camera, int width, int height, long skip,
                                            bool stack) {
    struct ddxvideo_geometry result = *camera;
    result.width = width ? width : camera->width & ~1;
    result.height = height ? height : camera->height & ~1;
    if (width)
        geometry_scale_aspect(&result, camera->width, camera->height);
    if (stack) {
        result.fields = 2;
        result.interlacing = 'p';
        set(&result.aspect_num, &result.aspect_den, result.aspect_num, (int64_t)result.aspect_den * 2);
    }
    if (result.rate_num)
        set(&result.rate_num, &result.rate_den, result.rate_num, (int64_t)result.rate_den * skip);
    return result;
}
