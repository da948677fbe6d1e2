/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Converts pictures of the store to RGB, and writes them into files: PPM, PNG, JPEG. */
#ifndef DDXVIDEO_IMAGE_H
#define DDXVIDEO_IMAGE_H

#include <ddxvideo.h>
#include <libavutil/frame.h>

enum image_format { IMAGE_UNKNOWN, IMAGE_PPM, IMAGE_PNG, IMAGE_JPEG };

/* By the file's name: .ppm, .png, .jpg, .jpeg */
enum image_format image_format_of(const char *path);

/* An empty picture (black), 24 bits RGB. NULL: no memory. The caller's, until av_frame_free(). */
AVFrame *image_new(int width, int height);

/* Draw a picture of the store into a part of an image, scaled to fill it. 0, or -errno. */
int image_draw(AVFrame *image, const struct ddxvideo_picture *picture, int x, int y, int width, int height);

/* Write the image into a file, whole or not at all. 0, or -errno. */
int image_save(const AVFrame *image, enum image_format format, const char *path);

#endif
