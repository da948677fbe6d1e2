/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "view.h"

#include <stdarg.h>
#include <stdio.h>

#define STALLED VIEW_NS /* without a frame; or three frames' time, if that is longer */

void view_say(struct view *view, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(view->message, sizeof view->message, format, arguments);
    va_end(arguments);
    view->message_until = ddx_time_now() + VIEW_MESSAGE;
    view->dirty = true;
}

void view_name(struct view *view) {
    char title[sizeof view->source->name + sizeof " - ddxvideoview"];

    snprintf(title, sizeof title, "%s - ddxvideoview", view->source->name);
    surface_title(view->surface, title);
}

bool view_is_stalled(struct view *view) {
    const struct ddxvideo_geometry *geometry = view->shot ? &view->shot->picture.geometry : NULL;
    int64_t limit = STALLED;

    if (!geometry || !view->source->live || view->paused)
        return false;
    if (geometry->rate_num && 3 * VIEW_NS / geometry->rate_num * geometry->rate_den > limit)
        limit = 3 * VIEW_NS / geometry->rate_num * geometry->rate_den;
    return ddx_time_now() - view->shot->arrival > limit;
}
