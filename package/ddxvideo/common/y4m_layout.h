/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_Y4M_LAYOUT_H
#define DDXVIDEO_Y4M_LAYOUT_H

#include "y4m.h"

/* The layout of this C tag, or NULL. */
const struct y4m_layout *y4m_layout_named(const char *tag);

/* The C tag of an enum ddx_video_format; NULL: no file can have such pictures. */
const char *y4m_layout_tag(int format);

#endif
