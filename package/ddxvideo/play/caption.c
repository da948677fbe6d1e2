/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "caption.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "paint.h"
#include "text.h"

#define NS INT64_C(1000000000)
#define MS INT64_C(1000000)
#define MARGIN 2 /* pixels, times the scale */
#define GROUND 0x000000
#define PLAIN 0xffffff
#define ALARM 0xffc020

static void write_frame(const struct caption_facts *facts, char *text, size_t size) {
    snprintf(text, size, "%s  frame %d", facts->name, facts->frame);
    if (facts->rate > 0)
        text_append(text, size, "  %.1f/s", facts->rate);
    if (facts->age < NS)
        text_append(text, size, "  age %d ms", (int)(facts->age / MS));
    else
        text_append(text, size, "  age %lld s", (long long)(facts->age / NS));
    if (facts->writer.counted)
        text_append(text, size, "  lost %llu", (unsigned long long)facts->writer.lost);
}

static void write_missing(const struct caption_facts *facts, char *text, size_t size) {
    time_t begin = time(NULL) - (time_t)(facts->since / NS);
    struct tm wall;
    char clock[16] = "";

    if (localtime_r(&begin, &wall))
        strftime(clock, sizeof clock, "%H:%M:%S", &wall);
    snprintf(text, size, "%s since %s (%lld s)", facts->missing, clock, (long long)(facts->since / NS));
}

struct caption caption_make(const struct caption_facts *facts, bool wanted) {
    struct caption caption = {.line = {"", ""}};

    if (wanted && facts->shown)
        write_frame(facts, caption.line[0], sizeof caption.line[0]);
    if (facts->missing)
        write_missing(facts, caption.line[1], sizeof caption.line[1]);
    return caption;
}

void caption_draw(const struct caption *caption, const struct canvas *canvas) {
    int scale = text_scale(canvas->height), margin = MARGIN * scale;
    int height = TEXT_CELL_HEIGHT * scale + margin, y = canvas->height;

    for (int i = 1; i >= 0; i--) {
        const char *line = caption->line[i];

        if (!*line)
            continue;
        y -= height;
        struct canvas ground =
            paint_part(canvas, 0, y, (int)strlen(line) * TEXT_CELL_WIDTH * scale + 2 * margin, height);
        paint_all(&ground, GROUND);
        text_write(canvas, margin, y + margin, scale, i ? ALARM : PLAIN, line);
    }
}
