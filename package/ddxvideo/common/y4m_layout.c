/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The chroma layouts that Y4M knows, and how large their planes are. */
#include <string.h>

#include "y4m_layout.h"

#define J DDX_VIDEO_420_JPEG
#define M DDX_VIDEO_420_MPEG2
#define NO (-1)

/* 4:2:0 made from another layout has the siting of its source, if that has one: chroma on the left luma column;
 * otherwise in the middle. */
static const struct y4m_layout layouts[] = {
    {"420jpeg", J, J, 8, 1, 1, false},
    {"420mpeg2", M, M, 8, 1, 1, false},
    {"420paldv", DDX_VIDEO_420_PALDV, DDX_VIDEO_420_PALDV, 8, 1, 1, false},
    {"420", DDX_VIDEO_420, DDX_VIDEO_420, 8, 1, 1, false},
    {"411", M, NO, 8, 2, 0, false},
    {"410", J, NO, 8, 2, 2, false},
    {"422", M, DDX_VIDEO_YUV422P, 8, 1, 0, false},
    {"444", M, DDX_VIDEO_YUV444P, 8, 0, 0, false},
    {"444alpha", M, NO, 8, 0, 0, true},
    {"mono", J, DDX_VIDEO_GREY8, 8, -1, -1, false},
    {"420p9", M, NO, 9, 1, 1, false},
    {"420p10", M, NO, 10, 1, 1, false},
    {"420p12", M, NO, 12, 1, 1, false},
    {"420p14", M, NO, 14, 1, 1, false},
    {"420p16", M, NO, 16, 1, 1, false},
    {"422p9", M, NO, 9, 1, 0, false},
    {"422p10", M, NO, 10, 1, 0, false},
    {"422p12", M, NO, 12, 1, 0, false},
    {"422p14", M, NO, 14, 1, 0, false},
    {"422p16", M, NO, 16, 1, 0, false},
    {"444p9", M, NO, 9, 0, 0, false},
    {"444p10", M, NO, 10, 0, 0, false},
    {"444p12", M, NO, 12, 0, 0, false},
    {"444p14", M, NO, 14, 0, 0, false},
    {"444p16", M, NO, 16, 0, 0, false},
    {"mono9", J, NO, 9, -1, -1, false},
    {"mono10", J, NO, 10, -1, -1, false},
    {"mono12", J, NO, 12, -1, -1, false},
    {"mono14", J, NO, 14, -1, -1, false},
    {"mono16", J, DDX_VIDEO_GREY16, 16, -1, -1, false},
};

const struct y4m_layout *y4m_layout_named(const char *tag) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (!strcmp(layouts[i].tag, tag))
            return &layouts[i];
    return NULL;
}

const char *y4m_layout_tag(int format) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (layouts[i].same == format)
            return layouts[i].tag;
    return NULL;
}

bool y4m_has(int format) {
    return y4m_layout_tag(format);
}

bool y4m_is_plain(const struct y4m_header *header) {
    return header->layout->same == header->geometry.format;
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
