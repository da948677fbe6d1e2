/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosnap: the newest frame of a video item, or of all of them, as a picture file; or one after another. */
#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "jpeg.h"
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
    bool montage, answer;
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

/* ---- Pictures for another program, on request ---- */

#define ANSWER_WAIT 1.0 /* s for a newer frame */
#define REQUEST 64      /* bytes of a line */

struct wanted {
    uint64_t after; /* the frame that the other program has; 0: none */
    struct jpeg_form form;
};

struct answering {
    DDX_STORE_ITEM *item;
    struct jpeg_encoder encoder;
    /* The last picture, which several may ask for. */
    struct wanted made; /* `after` is its own number */
    const unsigned char *bytes;
    size_t size;
};

/* Hold the newest frame, if it is not the one that the other program has: after a loss of the store, numbers begin
 * again. 0, -ETIMEDOUT: there is none, or another -errno. */
static int hold_newer(DDX_STORE_ITEM *item, uint64_t after, struct ddx_frame *frame) {
    struct ddx_item_info info;
    int error = ddx_store_acquire(item, frame, 0, DDX_CURRENT);

    if (!error && frame->sequence == after) {
        ddx_store_release(item);
        error = -ETIMEDOUT;
    }
    if (error == -ETIMEDOUT)
        error = ddx_store_acquire(item, frame, ANSWER_WAIT, DDX_NEXT);
    if (error == -ETIMEDOUT && ddx_store_item_info(item, &info))
        error = -ECONNREFUSED; /* or no frame would ever come */
    return error;
}

/* Encode a frame that is held, once for all that ask for the same. */
static int make(struct answering *answering, const struct ddxvideo_picture *picture, uint64_t sequence,
                const struct jpeg_form *form) {
    const struct wanted *made = &answering->made;

    if (made->after == sequence && made->form.quality == form->quality && made->form.divisor == form->divisor)
        return 0;
    answering->made = (struct wanted){.after = 0};
    int error = jpeg_encode(&answering->encoder, picture, form, &answering->bytes, &answering->size);
    if (!error)
        answering->made = (struct wanted){sequence, *form};
    return error;
}

static int answer_with_picture(struct answering *answering, const struct ddx_frame *frame,
                               const struct jpeg_form *form) {
    struct ddxvideo_picture picture;
    int error = ddxvideo_view_any(answering->item, frame->data, &picture);

    if (!error)
        error = make(answering, &picture, frame->sequence, form);
    if (error)
        return error;
    int64_t age = (ddx_time_now() - (picture.stamp.time ? picture.stamp.time : frame->time)) / 1000;
    printf("picture %" PRIu64 " %d %" PRId64 " %" PRId64 " %zu\n", frame->sequence, picture.stamp.frame,
           age > 0 ? age : 0, picture.stamp.source_lost, answering->size);
    fwrite(answering->bytes, 1, answering->size, stdout);
    return 0;
}

/* A line of request: "AFTER QUALITY DIVISOR". */
static bool read_request(struct wanted *wanted) {
    char line[REQUEST], end;

    if (!fgets(line, sizeof line, stdin))
        return false;
    if (line[strspn(line, "0123456789 \n")] || *line == ' ' ||
        sscanf(line, "%20" SCNu64 " %2d %1d%c", &wanted->after, &wanted->form.quality, &wanted->form.divisor, &end) !=
            4 ||
        end != '\n' || wanted->form.quality < JPEG_BEST || wanted->form.quality > JPEG_SMALLEST ||
        wanted->form.divisor < 1 || wanted->form.divisor > 2)
        program_bad_usage("a request is AFTER QUALITY DIVISOR: a frame's number, %d to %d, 1 or 2", JPEG_BEST,
                          JPEG_SMALLEST);
    return true;
}

/* Returns after a refusal: its reason may be a store that was lost, and the next start connects to the new one. */
static int answer_all(struct snap *snap) {
    DDX_STORE_ID *id = ddx_store_open(NULL, (int)snap->program.port, 1.0);
    int error = id ? 0 : -errno;
    struct answering answering = {.item = id ? ddx_store_lookup_item(id, snap->name, NULL, 0) : NULL};
    struct wanted wanted;

    if (!error && !answering.item)
        error = -errno;
    while ((!error || error == -ETIMEDOUT) && !ferror(stdout) && read_request(&wanted)) {
        struct ddx_frame frame;

        error = hold_newer(answering.item, wanted.after, &frame);
        if (!error) {
            error = answer_with_picture(&answering, &frame, &wanted.form);
            ddx_store_release(answering.item);
        }
        if (error == -ETIMEDOUT)
            puts("nothing");
        if (fflush(stdout))
            break;
    }
    bool refused = error && error != -ETIMEDOUT;
    if (refused) {
        printf("refused %s\n", as_420_error(error));
        fflush(stdout);
    }
    jpeg_close(&answering.encoder);
    ddx_store_close(id);
    return refused || ferror(stdout) ? EXIT_FAILED : EXIT_OK;
}

/* ---- Program ---- */

int main(int argc, char **argv) {
    static struct snap snap = {.name = "video"};
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item (default: video)", OPTION_NAME, &snap.name, 0, 0},
        {"montage", NULL, "all video items side by side, with name, frame and age", OPTION_FLAG, &snap.montage, 0, 0},
        {"answer", NULL, "pictures on request, for another program, instead of FILE; see below", OPTION_FLAG,
         &snap.answer, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    snap.program = (struct program){
        .name = "ddxvideosnap",
        .positional = "FILE",
        .optional = true,
        .purpose = "The newest frame of a video item as a picture: .ppm, .png or .jpg, by the name of FILE. An\n"
                   "existing file is replaced when the new one is complete.",
        .notes =
            "A single picture has the pixels of the frame; in a montage pictures keep their shape.\n"
            "\n"
            "With -answer, each line of standard input is a request: AFTER QUALITY DIVISOR, for example 0 6 1.\n"
            "AFTER is the number of the frame that the other program has, QUALITY is 2 (the best) to 31, DIVISOR\n"
            "1, or 2 for half the width and height. The answer on standard output is one of:\n"
            "  picture SEQUENCE FRAME AGE LOST BYTES\n"
            "           and that many bytes, the newest frame as JPEG: its number in the store, from 1; its number\n"
            "           in the source's count; its age, in us; the frames that the source has lost so far\n"
            "  nothing  there is no other frame than AFTER within a second\n"
            "  refused REASON\n"
            "           the item cannot be shown, for example because there is none; the program exits with 1",
        .options = options,
        .brief = true,
    };
    program_start(&snap.program, argc, argv);
    snap.path = snap.program.argument;
    if (snap.answer) {
        if (snap.path || snap.montage)
            program_bad_usage("-answer takes neither -montage nor a file");
        signal(SIGTERM, SIG_DFL); /* there is nothing to finish */
        signal(SIGINT, SIG_DFL);
        return snap.program.check ? EXIT_OK : answer_all(&snap);
    }
    if (!snap.path)
        program_bad_usage("FILE is missing");
    enum image_format format = image_format_of(snap.path);
    if (!format)
        program_bad_usage("%s: a name that ends in .ppm, .png or .jpg is needed", snap.path);
    return snap.program.check ? EXIT_OK : run(&snap, format);
}
