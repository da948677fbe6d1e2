/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "save.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "image.h"
#include "program.h"

#define NAMES 1000 /* of one frame */

/* A name that no file has yet. */
static void choose_name(const struct view *view, char *path, size_t size) {
    const char *name = view->source->name;
    int frame = view->shot->picture.stamp.frame;

    snprintf(path, size, "./%s-%06d.png", name, frame);
    for (int i = 2; i < NAMES && !access(path, F_OK); i++)
        snprintf(path, size, "./%s-%06d-%d.png", name, frame, i);
}

static int save_as(const struct ddxvideo_picture *picture, const char *path) {
    const struct ddxvideo_geometry *geometry = &picture->geometry;
    AVFrame *image = image_new(geometry->width, geometry->height);
    int error = image ? image_draw(image, picture, 0, 0, geometry->width, geometry->height) : -ENOMEM;

    if (!error)
        error = image_save(image, IMAGE_PNG, path);
    av_frame_free(&image);
    return error;
}

void save_shot(struct view *view) {
    char path[200];

    if (!view->shot) {
        view_say(view, "there is no frame to save");
        return;
    }
    choose_name(view, path, sizeof path);
    int error = save_as(&view->shot->picture, path);
    if (error) {
        view_say(view, "%s: %s", path + 2, strerror(-error));
        say("%s: %s", path + 2, strerror(-error));
    } else {
        view_say(view, "saved %s", path + 2);
    }
}
