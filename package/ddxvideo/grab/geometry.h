/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Geometry of the result, from that of the camera's pictures, and sizes of pictures by name. */
#ifndef DDXVIDEO_GEOMETRY_H
#define DDXVIDEO_GEOMETRY_H

#include <ddxvideo.h>
#include <stdbool.h>

#include "video_layout.h"

/* Values of -size, for messages. */
#define SIZE_NAMES "QCIF, CIF, 4CIF, VGA, PAL, NTSC, 720p, 1080p, or WxH such as 640x480"

/* "CIF" (in any case) or "640x480": even sides, at most DDX_VIDEO_SIDE. False if it is no such size. */
bool size_parse(const char *text, int *width, int *height);

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
