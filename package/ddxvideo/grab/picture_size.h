/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_SIZE_H
#define DDXVIDEO_SIZE_H

#include <stdbool.h>

/* Values of -size, for messages. */
#define SIZE_NAMES "QCIF, CIF, 4CIF, VGA, PAL, NTSC, 720p, 1080p, or WxH such as 640x480"

/* "CIF" (in any case) or "640x480": even sides, at most DDX_VIDEO_SIDE. False if it is no such size. */
bool size_parse(const char *text, int *width, int *height);

#endif
