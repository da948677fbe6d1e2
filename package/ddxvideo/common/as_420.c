/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "as_420.h"

#include <errno.h>
#include <stdlib.h>

#include "picture_convert.h"
#include "video_layout.h"

struct ddxvideo_geometry as_420_geometry(const struct ddxvideo_geometry *from) {
    struct ddxvideo_geometry to = *from;

    if (video_layout_is_420(from->format))
        return to;
    to.format = DDX_VIDEO_420_MPEG2;
    to.width &= ~1;
    to.height &= ~1;
    if (to.height % (2 * to.fields))
        to.fields = 1;
    if (from->format == DDX_VIDEO_RGB24)
        to.range = DDX_VIDEO_RANGE_LIMITED;
    return to;
}

/* Makes a converter for pictures of this geometry, and memory for its result. */
static int set_up(struct as_420 *as, const struct ddxvideo_geometry *from) {
    const struct picture_kind kind = picture_kind_of(from);
    struct ddxvideo_picture *to = &as->picture;

    as_420_close(as);
    to->geometry = as_420_geometry(from);
    if (!to->geometry.width || !to->geometry.height)
        return -ERANGE;
    as->converter = picture_converter_new(&kind, &to->geometry);
    as->memory = malloc(video_layout_bytes(&to->geometry));
    if (!as->converter || !as->memory) {
        as_420_close(as);
        return -ENOMEM;
    }
    video_layout_place(to, as->memory);
    as->from = *from;
    return 0;
}

int as_420(struct as_420 *as, const struct ddxvideo_picture *picture, const struct ddxvideo_picture **result) {
    unsigned char *plane[3];

    *result = picture;
    if (video_layout_is_420(picture->geometry.format))
        return 0;
    int error =
        as->converter && ddxvideo_same_layout(&as->from, &picture->geometry) ? 0 : set_up(as, &picture->geometry);
    if (error)
        return error;
    for (int i = 0; i < 3; i++)
        plane[i] = as->memory + (as->picture.plane[i] - as->memory);
    as->picture.geometry = as_420_geometry(&picture->geometry);
    as->picture.stamp = picture->stamp;
    *result = &as->picture;
    return picture_convert(as->converter, picture->plane, picture->stride, plane, as->picture.stride) ? 0 : -ENOMEM;
}

const char *as_420_error(int error) {
    switch (error) {
    case -ERANGE: return "it is smaller than 2x2";
    case -EBADMSG: return "its numbers do not fit its memory";
    default: return ddx_error_text(error);
    }
}

void as_420_close(struct as_420 *as) {
    picture_converter_free(as->converter);
    free(as->memory);
    *as = (struct as_420){.converter = NULL};
}
