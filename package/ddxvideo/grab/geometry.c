/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "geometry.h"

#include <strings.h>

#include "fraction.h"

static const struct {
    const char *name;
    int width, height;
} names[] = {
    {"QCIF", 176, 144}, {"CIF", 352, 288},  {"4CIF", 704, 576},  {"VGA", 640, 480},
    {"PAL", 720, 576},  {"NTSC", 720, 480}, {"720p", 1280, 720}, {"1080p", 1920, 1080},
};

/* Reads digits up to `end`; 0: anything else, or too large. */
static int side(const char **text, char end) {
    int value = 0;

    while (**text >= '0' && **text <= '9' && value <= DDX_VIDEO_SIDE)
        value = value * 10 + *(*text)++ - '0';
    return **text == end && value <= DDX_VIDEO_SIDE && value % 2 == 0 ? value : 0;
}

bool size_parse(const char *text, int *width, int *height) {
    for (unsigned i = 0; i < sizeof names / sizeof *names; i++) {
        if (!strcasecmp(text, names[i].name)) {
            *width = names[i].width;
            *height = names[i].height;
            return true;
        }
    }
    int w = side(&text, 'x');
    if (!w)
        return false;
    text++;
    int h = side(&text, '\0');
    if (!h)
        return false;
    *width = w;
    *height = h;
    return true;
}

void geometry_scale_aspect(struct ddxvideo_geometry *geometry, int width, int height) {
    if (!geometry->aspect_num)
        return;
    fraction_set(&width, &height, width, height);
    int64_t num = (int64_t)geometry->aspect_num * width, den = (int64_t)geometry->aspect_den * height;
    int64_t divisor = fraction_divisor(num, den);
    fraction_set(&geometry->aspect_num, &geometry->aspect_den, num / divisor * geometry->height,
                 den / divisor * geometry->width);
}

struct ddxvideo_geometry geometry_of_result(const struct ddxvideo_geometry *camera, int width, int height, long skip,
                                            bool stack, const struct video_layout *layout) {
    struct ddxvideo_geometry result = *camera;

    result.width = width ? width : camera->width - (layout->chroma_x == 1 ? camera->width % 2 : 0);
    result.height = height ? height : camera->height - (layout->chroma_y == 1 || stack ? camera->height % 2 : 0);
    if (!video_layout_is_420(layout->format)) /* for 4:2:0 the siting stays the camera's */
        result.format = layout->format;
    if (layout->format == DDX_VIDEO_RGB24)
        result.range = DDX_VIDEO_RANGE_FULL;
    if (width)
        geometry_scale_aspect(&result, camera->width, camera->height);
    if (stack) {
        result.fields = 2;
        result.interlacing = 'p';
        fraction_set(&result.aspect_num, &result.aspect_den, result.aspect_num, (int64_t)result.aspect_den * 2);
    }
    if (result.rate_num)
        fraction_set(&result.rate_num, &result.rate_den, result.rate_num, (int64_t)result.rate_den * skip);
    return result;
}
