/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The loop of the viewer: pictures, keys, time. */
#ifndef DDXVIDEO_VIEW_RUN_H
#define DDXVIDEO_VIEW_RUN_H

#include "view.h"

/* Until the user has enough of it: the program's exit status. The source is closed. */
int view_run(struct view *view);

#endif
