/* SPDX-License-Identifier: GPL-2.0-or-later */
/* From the camera's pictures to the result's. */
#ifndef DDXVIDEO_GEOMETRY_H
#define DDXVIDEO_GEOMETRY_H

#include <ddxvideo.h>
#include <stdbool.h>

#include "video_layout.h"

/* The picture was `width` by `height` when its pixels had this aspect, and now fills the geometry's size. */
void geometry_scale_aspect(struct ddxvideo_geometry *geometry, int width, int height);

/*
 * What becomes of the camera's pictures: in this layout, scaled to `width` by `height` (0: as they are, cut to
 * the sides that the layout can have), each skip-th of them, the two fields stacked or not. The numbers of luma stay
 * what they are, so the range is the camera's; RGB has the full one.
 */
struct ddxvideo_geometry geometry_of_result(const struct ddxvideo_geometry *camera, int width, int height, long skip,
                                            bool stack, const struct video_layout *layout);

#endif
