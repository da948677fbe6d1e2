/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Keys and pointer. */
#ifndef DDXVIDEO_INPUT_H
#define DDXVIDEO_INPUT_H

#include "view.h"

void input_handle(struct view *view, const struct surface_event *event);

/* The list of the keys, several lines. */
const char *input_help(void);

#endif
