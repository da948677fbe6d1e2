/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "picture.h"

#include <endian.h>
#include <string.h>

#define FIXED 64  /* bytes of an Image before its pixels, without its header */
#define SIDE 8192 /* as in ddxvideo.h */
#define RANGE_FULL 2

enum meaning { GREY, RGB, YUV };

/* By the numbers of enum ddx_video_format; those from 0 to 3 are 4:2:0. */
static const struct layout {
    int32_t format;
    enum meaning meaning;
    unsigned bytes;              /* of a pixel in plane y */
    unsigned chroma_x, chroma_y; /* log2 of the subsampling */
    const char *encoding;
} layouts[] = {
    {3, YUV, 1, 1, 1, "rgb8"},    {16, YUV, 1, 1, 0, "rgb8"},    {17, YUV, 1, 0, 0, "rgb8"},
    {18, GREY, 1, 0, 0, "mono8"}, {19, GREY, 2, 0, 0, "mono16"}, {20, RGB, 3, 0, 0, "rgb8"},
};

struct picture {
    const struct layout *layout;
    size_t width, height;
    bool full;
    const unsigned char *y, *u, *v;
};

static const struct form_leaf *leaf_of(const struct form *form, const char *name) {
    for (unsigned i = 0; i < form->leaf_count; i++)
        if (!strcmp(form->leaves[i].name, name))
            return &form->leaves[i];
    return NULL;
}

/* An item with the paper's seven fields only lacks the others, which are 0 then. */
static int64_t number_of(const struct form *form, const void *value, const char *name) {
    const struct form_leaf *leaf = leaf_of(form, name);
    const unsigned char *at = leaf ? (const unsigned char *)value + leaf->item : NULL;
    int32_t small;
    int64_t large;

    if (!leaf || (leaf->bytes != sizeof small && leaf->bytes != sizeof large))
        return 0;
    if (leaf->bytes == sizeof small) {
        memcpy(&small, at, sizeof small);
        return small;
    }
    memcpy(&large, at, sizeof large);
    return large;
}

/* A plane of this size; NULL: the item has fewer bytes. */
static const unsigned char *plane_of(const struct form *form, const void *value, const char *name, size_t bytes) {
    const struct form_leaf *leaf = leaf_of(form, name);

    return leaf && (size_t)leaf->bytes * leaf->count >= bytes ? (const unsigned char *)value + leaf->item : NULL;
}

static const struct layout *layout_of(int64_t format) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (layouts[i].format == (format >= 0 && format < 3 ? 3 : format))
            return &layouts[i];
    return NULL;
}

static bool view(const struct form *form, const void *value, struct picture *picture) {
    int64_t width = number_of(form, value, "width"), height = number_of(form, value, "height");
    const struct layout *layout = layout_of(number_of(form, value, "format"));

    if (!layout || width < 1 || width > SIDE || height < 1 || height > SIDE)
        return false;
    *picture = (struct picture){.layout = layout,
                                .width = (size_t)width,
                                .height = (size_t)height,
                                .full = number_of(form, value, "range") == RANGE_FULL};
    picture->y = plane_of(form, value, "y", picture->width * picture->height * layout->bytes);
    if (layout->meaning != YUV)
        return picture->y;
    size_t chroma = (picture->width >> layout->chroma_x) * (picture->height >> layout->chroma_y);
    bool whole = !(picture->width & layout->chroma_x) && !(picture->height & layout->chroma_y);
    picture->u = plane_of(form, value, "u", chroma);
    picture->v = plane_of(form, value, "v", chroma);
    return whole && picture->y && picture->u && picture->v;
}

bool picture_is(const struct form *form) {
    return !strcmp(form->type, "DDX_VIDEO") && leaf_of(form, "y");
}

size_t picture_size(const struct form *form) {
    const struct form_leaf *leaf = leaf_of(form, "y");

    return leaf ? FIXED + 3 * (size_t)leaf->bytes * leaf->count : FIXED;
}

int64_t picture_time(const struct form *form, const void *value, int64_t written) {
    int64_t time = number_of(form, value, "time"), offset = number_of(form, value, "wall_offset"), wall;

    return time && !__builtin_add_overflow(time, offset, &wall) && wall > 0 ? wall : written;
}

static unsigned char limited_to_byte(int number) {
    return (unsigned char)(number < 0 ? 0 : number > 255 ? 255 : number);
}

/* ITU-R BT.601, in 1/256. */
static void to_rgb(bool full, int y, int u, int v, unsigned char rgb[3]) {
    int luma = full ? 256 * y : 298 * (y - 16);

    rgb[0] = limited_to_byte((luma + (full ? 359 : 409) * v + 128) >> 8);
    rgb[1] = limited_to_byte((luma - (full ? 88 : 100) * u - (full ? 183 : 208) * v + 128) >> 8);
    rgb[2] = limited_to_byte((luma + (full ? 454 : 516) * u + 128) >> 8);
}

static void convert(const struct picture *picture, unsigned char *to) {
    const struct layout *layout = picture->layout;
    size_t width = picture->width >> layout->chroma_x;

    for (size_t row = 0; row < picture->height; row++) {
        const unsigned char *y = picture->y + row * picture->width;
        const unsigned char *u = picture->u + (row >> layout->chroma_y) * width;
        const unsigned char *v = picture->v + (row >> layout->chroma_y) * width;

        for (size_t i = 0; i < picture->width; i++, to += 3)
            to_rgb(picture->full, y[i], u[i >> layout->chroma_x] - 128, v[i >> layout->chroma_x] - 128, to);
    }
}

static size_t put(unsigned char *message, size_t at, size_t number) {
    uint32_t little = htole32((uint32_t)number);

    for (; at % sizeof little; at++) /* CDR's header has as many bytes */
        message[at] = 0;
    memcpy(message + at, &little, sizeof little);
    return at + sizeof little;
}

size_t picture_write(const struct form *form, const void *value, unsigned char *message, size_t at) {
    struct picture picture;

    if (!view(form, value, &picture))
        return 0;
    const struct layout *layout = picture.layout;
    size_t length = strlen(layout->encoding) + 1, pixels = picture.width * picture.height;
    size_t bytes = layout->meaning == YUV ? 3 : layout->bytes;

    at = put(message, at, picture.height);
    at = put(message, at, picture.width);
    at = put(message, at, length);
    memcpy(message + at, layout->encoding, length);
    at += length;
    message[at++] = 0; /* not big-endian */
    at = put(message, at, picture.width * bytes);
    at = put(message, at, pixels * bytes);
    if (layout->meaning == YUV)
        convert(&picture, message + at);
    else
        memcpy(message + at, picture.y, pixels * bytes);
    return at + pixels * bytes;
}
