/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The chroma layouts that Y4M knows, and how large their planes are. */
#include <string.h>

#include "y4m_layout.h"

#define J DDX_VIDEO_420_JPEG
#define M DDX_VIDEO_420_MPEG2

/* What is converted gets the siting of its source, where that has one: chroma on the left luma column, else in the
 * middle. */
static const struct y4m_layout layouts[] = {
    {"420jpeg", J, 8, 1, 1, false},
    {"420mpeg2", M, 8, 1, 1, false},
    {"420paldv", DDX_VIDEO_420_PALDV, 8, 1, 1, false},
    {"420", DDX_VIDEO_420, 8, 1, 1, false},
    {"411", M, 8, 2, 0, false},
    {"410", J, 8, 2, 2, false},
    {"422", M, 8, 1, 0, false},
    {"444", M, 8, 0, 0, false},
    {"444alpha", M, 8, 0, 0, true},
    {"mono", J, 8, -1, -1, false},
    {"420p9", M, 9, 1, 1, false},
    {"420p10", M, 10, 1, 1, false},
    {"420p12", M, 12, 1, 1, false},
    {"420p14", M, 14, 1, 1, false},
    {"420p16", M, 16, 1, 1, false},
    {"422p9", M, 9, 1, 0, false},
    {"422p10", M, 10, 1, 0, false},
    {"422p12", M, 12, 1, 0, false},
    {"422p14", M, 14, 1, 0, false},
    {"422p16", M, 16, 1, 0, false},
    {"444p9", M, 9, 0, 0, false},
    {"444p10", M, 10, 0, 0, false},
    {"444p12", M, 12, 0, 0, false},
    {"444p14", M, 14, 0, 0, false},
    {"444p16", M, 16, 0, 0, false},
    {"mono9", J, 9, -1, -1, false},
    {"mono10", J, 10, -1, -1, false},
    {"mono12", J, 12, -1, -1, false},
    {"mono14", J, 14, -1, -1, false},
    {"mono16", J, 16, -1, -1, false},
};

const struct y4m_layout *y4m_layout_named(const char *tag) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (!strcmp(layouts[i].tag, tag))
            return &layouts[i];
    return NULL;
}

const char *y4m_layout_tag(int format) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (layouts[i].format == format && y4m_is_plain(&layouts[i]))
            return layouts[i].tag;
    return "420";
}

bool y4m_is_plain(const struct y4m_layout *layout) {
    return layout->bits == 8 && layout->chroma_x == 1 && layout->chroma_y == 1;
}

size_t y4m_plane_bytes(const struct y4m_header *header, int plane) {
    const struct y4m_layout *layout = header->layout;
    size_t width = (size_t)header->geometry.width, height = (size_t)header->geometry.height;
    size_t sample = layout->bits > 8 ? 2 : 1;

    if (plane == 1 || plane == 2) {
        if (layout->chroma_x < 0)
            return 0;
        width = (width + (1u << layout->chroma_x) - 1) >> layout->chroma_x;
        height = (height + (1u << layout->chroma_y) - 1) >> layout->chroma_y;
    } else if (plane == 3 && !layout->alpha) {
        return 0;
    }
    return width * height * sample;
}
