/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The viewer's main loop: pictures, keys, time. */
#ifndef DDXVIDEO_VIEW_RUN_H
#define DDXVIDEO_VIEW_RUN_H

#include "view.h"

/* Run until the user quits. Returns the exit status. Closes the source. */
int view_run(struct view *view);

#endif
