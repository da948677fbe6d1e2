/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "video_layout.h"

#include <string.h>
#include <strings.h>

static const struct video_layout layouts[] = {
    {"YUV420P", DDX_VIDEO_420, "char", 1, 1, 1, 1},
    {"YUV422P", DDX_VIDEO_YUV422P, "unsigned char", 1, 1, 1, 0},
    {"YUV444P", DDX_VIDEO_YUV444P, "unsigned char", 1, 1, 0, 0},
    {"GREY8", DDX_VIDEO_GREY8, "unsigned char", 1, 1, -1, -1},
    {"GREY16", DDX_VIDEO_GREY16, "unsigned short", 2, 1, -1, -1},
    {"RGB24", DDX_VIDEO_RGB24, "unsigned char", 1, 3, -1, -1},
};

const struct video_layout *video_layout_of(int format) {
    if (video_layout_is_420(format))
        return &layouts[0];
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (layouts[i].format == format)
            return &layouts[i];
    return NULL;
}

const struct video_layout *video_layout_named(const char *name) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (!strcasecmp(layouts[i].name, name))
            return &layouts[i];
    return NULL;
}

const char *ddxvideo_layout_name(int format) {
    const struct video_layout *layout = video_layout_of(format);

    return layout ? layout->name : NULL;
}

void video_layout_plane(const struct video_layout *layout, int width, int height, int plane, int *stride, int *rows) {
    *stride = *rows = 0;
    if (!plane) {
        *stride = width * layout->samples * layout->bytes;
        *rows = height;
    } else if (layout->chroma_x >= 0) {
        *stride = (width >> layout->chroma_x) * layout->bytes;
        *rows = height >> layout->chroma_y;
    }
}

size_t video_layout_bytes(const struct ddxvideo_geometry *geometry) {
    size_t bytes = 0;

    for (int plane = 0; plane < 3; plane++) {
        int stride, rows;

        video_layout_plane(video_layout_of(geometry->format), geometry->width, geometry->height, plane, &stride, &rows);
        bytes += (size_t)stride * (size_t)rows;
    }
    return bytes;
}

void video_layout_place(struct ddxvideo_picture *picture, unsigned char *memory) {
    const struct ddxvideo_geometry *geometry = &picture->geometry;

    for (int i = 0; i < 3; i++) {
        video_layout_plane(video_layout_of(geometry->format), geometry->width, geometry->height, i, &picture->stride[i],
                           &picture->rows[i]);
        picture->plane[i] = picture->rows[i] ? memory : NULL;
        memory += (size_t)picture->stride[i] * (size_t)picture->rows[i];
    }
}

void video_layout_copy(struct ddxvideo_picture *to, const struct ddxvideo_picture *from, unsigned char *memory) {
    *to = *from;
    video_layout_place(to, memory);
    for (int i = 0; i < 3; i++)
        for (int row = 0; row < to->rows[i]; row++, memory += to->stride[i])
            memcpy(memory, from->plane[i] + (ptrdiff_t)row * from->stride[i], (size_t)to->stride[i]);
}
