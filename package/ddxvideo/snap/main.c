/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosnap: the newest frame of a video item, or of all of them, as a picture file. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "program.h"
#include "text.h"

/* ---- A grid of pictures, side by side ---- */

#define MONTAGE_MAX 64     /* items */
#define MONTAGE_SIDE 16384 /* pixels */

struct montage_place {
    int x, y, width, height;
    int right; /* of the cell: the limit of a caption */
    int scale; /* of its text */
};

#define INK 0xe0e0e0
#define LINE (TEXT_CELL_HEIGHT + 2)

/* A picture's shape in pixels that are square. */
static void square(const struct ddxvideo_geometry *picture, int *width, int *height) {
    *width = picture->width;
    *height = picture->height;
    if (picture->aspect_num > 0 && picture->aspect_den > 0) {
        int64_t wide = (int64_t)picture->width * picture->aspect_num / picture->aspect_den;

        if (wide > 0 && wide <= DDX_VIDEO_SIDE)
            *width = (int)wide;
    }
}

/* The largest size of this shape that fits. */
static void fit(int64_t width, int64_t height, struct montage_place *place) {
    if (width * place->height >= height * place->width) {
        height = height * place->width / width;
        width = place->width;
    } else {
        width = width * place->height / height;
        height = place->height;
    }
    place->x += (int)(place->width - width) / 2;
    place->y += (int)(place->height - height) / 2;
    place->width = width > 0 ? (int)width : 1;
    place->height = height > 0 ? (int)height : 1;
}

/*
 * Place `count` pictures in rows from the top left. Cells are as large as the largest picture, or smaller if the whole
 * would exceed MONTAGE_SIDE. Each picture keeps its shape in the middle of its cell, with a line of text below it. The
 * size of the whole is in *width, *height.
 */
static void montage_plan(const struct ddxvideo_geometry *pictures, unsigned count, struct montage_place *places,
                         int *width, int *height) {
    int columns = 1, cell_width = 1, cell_height = 1;

    while ((unsigned)(columns * columns) < count)
        columns++;
    int rows = ((int)count + columns - 1) / columns;
    for (unsigned i = 0; i < count; i++) {
        int wide, high;

        square(&pictures[i], &wide, &high);
        cell_width = wide > cell_width ? wide : cell_width;
        cell_height = high > cell_height ? high : cell_height;
    }
    while (cell_width * columns > MONTAGE_SIDE ||
           (cell_height + LINE * text_scale(cell_height)) * rows > MONTAGE_SIDE) {
        cell_width = cell_width > 1 ? cell_width / 2 : 1;
        cell_height = cell_height > 1 ? cell_height / 2 : 1;
    }
    int scale = text_scale(cell_height), line = LINE * scale;
    *width = cell_width * columns;
    *height = (cell_height + line) * rows;
    for (unsigned i = 0; i < count; i++) {
        int wide, high;

        square(&pictures[i], &wide, &high);
        int x = (int)i % columns * cell_width, y = (int)i / columns * (cell_height + line);
        places[i] = (struct montage_place){x, y, cell_width, cell_height, x + cell_width, scale};
        fit(wide, high, &places[i]);
    }
}

/* Write the caption below a picture. 0 or -ENOMEM. */
static int montage_caption(AVFrame *image, const struct montage_place *place, const char *text) {
    struct canvas canvas = {NULL, place->right - place->x, place->right - place->x, LINE * place->scale};
    int top = place->y + place->height;

    canvas.pixel = calloc((size_t)canvas.width * (size_t)canvas.height, sizeof *canvas.pixel);
    if (!canvas.pixel)
        return -ENOMEM;
    text_write(&canvas, 0, place->scale, place->scale, INK, text);
    for (int y = 0; y < canvas.height; y++) {
        uint8_t *to = image->data[0] + (ptrdiff_t)(top + y) * image->linesize[0] + 3 * (ptrdiff_t)place->x;

        for (int x = 0; x < canvas.width; x++)
            memset(to + 3 * x, (int)(canvas.pixel[y * canvas.width + x] & 255), 3);
    }
    free(canvas.pixel);
    return 0;
}

/* ---- The program ---- */

#define TIMEOUT 5.0 /* s to wait for a first frame */

struct snap {
    struct program program;
    const char *name, *path;
    bool montage;
    /* the pictures; their frames are held, so that they can be drawn without a copy */
    DDX_STORE_ITEM *item[MONTAGE_MAX];
    struct ddxvideo_picture picture[MONTAGE_MAX];
    int64_t time[MONTAGE_MAX]; /* of the capture; if not known, of the write */
    unsigned count;
};

static int fail(const char *what, int error) {
    say("%s: %s", what, ddx_error_text(error));
    return EXIT_FAILED;
}

/* Hold the newest frame of an item. 0, or -errno. */
static int take_picture(struct snap *snap, DDX_STORE_ID *id, const char *name, double timeout) {
    struct ddx_frame frame;
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);

    if (!item)
        return -errno;
    int error = ddx_store_acquire(item, &frame, timeout, DDX_CURRENT);
    if (!error)
        error = ddxvideo_view_any(item, frame.data, &snap->picture[snap->count]);
    if (error) {
        ddx_store_done_item(item);
        return error;
    }
    int64_t captured = snap->picture[snap->count].stamp.time;
    snap->time[snap->count] = captured ? captured : frame.time;
    snap->item[snap->count++] = item;
    return 0;
}

/* All video items that have a frame; items that cannot be shown are reported and left out. */
static int take_all(struct snap *snap, DDX_STORE_ID *id) {
    struct ddx_item_info *items;
    unsigned count;
    int error = ddx_store_list(id, NULL, &items, &count);

    if (error)
        return fail("store", error);
    for (unsigned i = 0; i < count && snap->count < MONTAGE_MAX; i++) {
        if (strcmp(items[i].type, "DDX_VIDEO") || !items[i].sequence)
            continue;
        error = take_picture(snap, id, items[i].name, 0);
        if (error)
            fail(items[i].name, error);
    }
    free(items);
    if (!snap->count)
        say("no video item has a frame");
    return snap->count ? EXIT_OK : EXIT_FAILED;
}

static int draw_one(const struct snap *snap, AVFrame **image) {
    const struct ddxvideo_geometry *geometry = &snap->picture[0].geometry;

    *image = image_new(geometry->width, geometry->height);
    return *image ? image_draw(*image, &snap->picture[0], 0, 0, geometry->width, geometry->height) : -ENOMEM;
}

static int draw_all(const struct snap *snap, AVFrame **image) {
    struct ddxvideo_geometry geometry[MONTAGE_MAX];
    struct montage_place place[MONTAGE_MAX];
    int width, height, error = 0;

    for (unsigned i = 0; i < snap->count; i++)
        geometry[i] = snap->picture[i].geometry;
    montage_plan(geometry, snap->count, place, &width, &height);
    *image = image_new(width, height);
    if (!*image)
        return -ENOMEM;
    for (unsigned i = 0; i < snap->count && !error; i++) {
        char text[DDX_NAME_MAX + 60];

        error = image_draw(*image, &snap->picture[i], place[i].x, place[i].y, place[i].width, place[i].height);
        snprintf(text, sizeof text, "%s  frame %d  %.2f s old", ddx_store_item_name(snap->item[i]),
                 snap->picture[i].stamp.frame, (double)(ddx_time_now() - snap->time[i]) / 1e9);
        if (!error)
            error = montage_caption(*image, &place[i], text);
    }
    return error;
}

static int save(const struct snap *snap, enum image_format format) {
    AVFrame *image;
    int error = snap->montage ? draw_all(snap, &image) : draw_one(snap, &image);

    if (!error)
        error = image_save(image, format, snap->path);
    av_frame_free(&image);
    if (error) {
        say("%s: %s", snap->path, strerror(-error));
        return EXIT_FAILED;
    }
    return EXIT_OK;
}

static int run(struct snap *snap, enum image_format format) {
    DDX_STORE_ID *id = ddx_store_open(NULL, (int)snap->program.port, 1.0);
    int status = EXIT_OK, error = id ? 0 : -errno;

    if (!id)
        return fail("store", error);
    if (snap->montage)
        status = take_all(snap, id);
    else if ((error = take_picture(snap, id, snap->name, TIMEOUT)))
        status = fail(snap->name, error);
    if (!status)
        status = save(snap, format);
    ddx_store_close(id);
    return status;
}

int main(int argc, char **argv) {
    static struct snap snap = {.name = "video"};
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item (default: video)", OPTION_NAME, &snap.name, 0, 0},
        {"montage", NULL, "all video items side by side, with name, frame and age", OPTION_FLAG, &snap.montage, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    snap.program = (struct program){
        .name = "ddxvideosnap",
        .positional = "FILE",
        .purpose = "The newest frame of a video item as a picture: .ppm, .png or .jpg, by the name of FILE. An\n"
                   "existing file is replaced when the new one is complete.",
        .notes = "A single picture has the pixels of the frame; in a montage pictures keep their shape.",
        .options = options,
        .brief = true,
    };
    program_start(&snap.program, argc, argv);
    snap.path = snap.program.argument;
    enum image_format format = image_format_of(snap.path);
    if (!format)
        program_bad_usage("%s: a name that ends in .ppm, .png or .jpg is needed", snap.path);
    return snap.program.check ? EXIT_OK : run(&snap, format);
}
