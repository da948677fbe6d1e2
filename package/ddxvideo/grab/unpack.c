/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "unpack.h"

/* Bytes in a row of the resulting planes. */
static void set_strides(const struct pixels *pixels, int stride[3]) {
    stride[0] = pixels->width;
    stride[1] = stride[2] = 0;
    switch (pixels_find(pixels->coding)->unpack) {
    case UNPACK_16:
    case UNPACK_16_LE: stride[0] = pixels->stride / 2; break;
    case UNPACK_411: stride[1] = stride[2] = pixels->width / 4; break;
    case UNPACK_444: stride[1] = stride[2] = pixels->width; break;
    case UNPACK_NOTHING: break;
    }
}

size_t unpack_size(const struct pixels *pixels) {
    int stride[3];

    set_strides(pixels, stride);
    return (size_t)(stride[0] + stride[1] + stride[2]) * (size_t)pixels->height;
}

/* Takes the eight upper ones of `depth` bits; values with more bits are clipped to the brightest one. */
static void take_upper_bits(const unsigned char *from, unsigned char *to, int samples, int depth) {
    for (int i = 0; i < samples; i++) {
        int value = (from[2 * i] << 8 | from[2 * i + 1]) >> (depth - 8);

        to[i] = (unsigned char)(value < 255 ? value : 255);
    }
}

/* Takes the upper bytes, which come second. */
static void take_second_bytes(const unsigned char *from, unsigned char *to, int samples) {
    for (int i = 0; i < samples; i++)
        to[i] = from[2 * i + 1];
}

/* U Y Y V Y Y: four pixels that share their chroma. */
static void part_411(const unsigned char *from, unsigned char *const to[3], int width) {
    for (int i = 0; i < width / 4; i++, from += 6) {
        to[1][i] = from[0];
        to[0][4 * i] = from[1];
        to[0][4 * i + 1] = from[2];
        to[2][i] = from[3];
        to[0][4 * i + 2] = from[4];
        to[0][4 * i + 3] = from[5];
    }
}

/* U Y V of each pixel. */
static void part_444(const unsigned char *from, unsigned char *const to[3], int width) {
    for (int i = 0; i < width; i++, from += 3) {
        to[1][i] = from[0];
        to[0][i] = from[1];
        to[2][i] = from[2];
    }
}

void unpack_run(const struct pixels *pixels, const unsigned char *from, unsigned char *to, unsigned char *plane[3],
                int stride[3]) {
    enum pixels_unpack unpack = pixels_find(pixels->coding)->unpack;

    set_strides(pixels, stride);
    for (int i = 0; i < 3; i++) {
        plane[i] = stride[i] ? to : NULL;
        to += (size_t)stride[i] * (size_t)pixels->height;
    }
    for (int row = 0; row < pixels->height; row++, from += pixels->stride) {
        unsigned char *at[3];

        for (int i = 0; i < 3; i++)
            at[i] = stride[i] ? plane[i] + (ptrdiff_t)row * stride[i] : NULL;
        if (unpack == UNPACK_16)
            take_upper_bits(from, at[0], pixels->stride / 2, pixels->depth);
        else if (unpack == UNPACK_16_LE)
            take_second_bytes(from, at[0], pixels->stride / 2);
        else if (unpack == UNPACK_411)
            part_411(from, at, pixels->width);
        else
            part_444(from, at, pixels->width);
    }
}
