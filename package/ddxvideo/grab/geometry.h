/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Geometry of the result, from that of the camera's pictures. */
#ifndef DDXVIDEO_GEOMETRY_H
#define DDXVIDEO_GEOMETRY_H

#include <ddxvideo.h>
#include <stdbool.h>

#include "video_layout.h"

/* Adapt the aspect of pixels in a picture that was scaled from `width` by `height` to the geometry's size. */
void geometry_scale_aspect(struct ddxvideo_geometry *geometry, int width, int height);

/*
 * The result for the camera's pictures: in this layout, scaled to `width` by `height` (0: not scaled, but cut to sides
 * that the layout can have), one of `skip` frames, the two fields stacked or not. Luma values do not change, so the
 * range is the camera's; RGB has the full one.
 */
struct ddxvideo_geometry geometry_of_result(const struct ddxvideo_geometry *camera, int width, int height, long skip,
                                            bool stack, const struct video_layout *layout);

#endif
