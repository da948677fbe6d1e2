/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The items beside a video item: frame counter, parameters, scale of a range picture. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "ddxvideo.h"

_Static_assert(sizeof(DDX_VIDEO_PARAMETERS) == 4 + 56 * DDX_VIDEO_PARAMETERS_MAX, "layout");

static int create_beside(DDX_STORE_ID *id, const char *video_name, const char *suffix, struct ddx_item_spec *spec,
                         DDX_STORE_ITEM **item) {
    char name[DDX_NAME_MAX + 1];
    int length = snprintf(name, sizeof name, "%s.%s", video_name, suffix);

    if (length < 0 || (size_t)length >= sizeof name)
        return -EINVAL;
    spec->name = name;
    return ddx_store_create(id, spec, item);
}

int ddxvideo_counter_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "int", .declaration = "int", .size = sizeof(int)};

    return create_beside(id, video_name, "frame", &spec, item);
}

int ddxvideo_counter_write(DDX_STORE_ITEM *item, int frame) {
    return ddx_store_write(item, &frame, NULL);
}

int ddxvideo_parameters_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "DDX_VIDEO_PARAMETERS", .size = sizeof(DDX_VIDEO_PARAMETERS)};

    return create_beside(id, video_name, "parameters", &spec, item);
}

int ddxvideo_parameters_write(DDX_STORE_ITEM *item, const DDX_VIDEO_PARAMETERS *parameters) {
    if (parameters->count < 0 || parameters->count > DDX_VIDEO_PARAMETERS_MAX)
        return -EINVAL;
    for (int i = 0; i < parameters->count; i++)
        if (!memchr(parameters->parameter[i].name, 0, sizeof parameters->parameter[i].name))
            return -EINVAL;
    return ddx_store_write(item, parameters, NULL);
}

int ddxvideo_stereo_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item) {
    struct ddx_item_spec spec = {.type = "DDX_VIDEO_STEREO", .size = sizeof(DDX_VIDEO_STEREO)};

    return create_beside(id, video_name, "stereo", &spec, item);
}
