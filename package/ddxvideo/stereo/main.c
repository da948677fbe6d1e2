/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoSVS: range from a stereo pair. */
#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "calibration.h"
#include "ddx_time.h"
#include "matcher.h"
#include "source.h"

/*
 * Computes range from a pair, and writes the items NAME (three fields: right, range, left), NAME.disparity and
 * NAME.stereo.
 */
struct ranger {
    /* Set before ranger_run(): */
    const char *name;
    const char *calibration_path;
    struct calibration calibration;
    struct matcher_settings settings; /* width and height are set by ranger_run() */
    /* Private, 0 at first: */
    struct ddxvideo_geometry eye; /* size that the tables are made for; width 0: none yet */
    struct rectifier *rectifier[2];
    struct matcher *matcher;
    DDX_STORE_ITEM *range, *disparity, *stereo;
    bool refused; /* a line has reported it */
    uint8_t level[256];
};

/* ---- Rectification ---- */

/*
 * Converts a camera's picture into that of an ideal camera: without distortion, and with the other camera's rows. A
 * table has the position of each pixel in the camera's picture, in 1/32 pixel.
 *
 * The right picture is projected with the left one's centre: a point at infinity has disparity 0 in each calibration.
 */

#define PARTS 32 /* of a pixel, as in OpenCV's tables */
#define OUTSIDE (-1)

/* The upper left of four pixels, and the shares of the pixels to its right and below it, of PARTS. */
struct place {
    int16_t x, y;
    uint8_t right, below;
};

struct rectifier {
    int width, height;
    struct place place[];
};

/* The inverse of a 3x3 matrix. */
static void invert(const double m[9], double to[9]) {
    double a = m[4] * m[8] - m[5] * m[7], b = m[5] * m[6] - m[3] * m[8], c = m[3] * m[7] - m[4] * m[6];
    double determinant = m[0] * a + m[1] * b + m[2] * c;
    const double adjugate[9] = {a, m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                                b, m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                                c, m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};

    for (int i = 0; i < 9; i++)
        to[i] = adjugate[i] / determinant;
}

/* From pixels of the rectified picture to rays of the camera: the inverse of projection * rotation. */
static void rays_of(const struct calibration *calibration, enum eye eye, double rays[9]) {
    const double *r = calibration->eye[eye].rotation, *p = calibration->eye[LEFT].projection;
    double product[9];

    for (int i = 0; i < 9; i++) {
        int row = i / 3 * 4, column = i % 3;
        product[i] = p[row] * r[column] + p[row + 1] * r[3 + column] + p[row + 2] * r[6 + column];
    }
    invert(product, rays);
}

/* The camera's pixel for the point (x, y) at distance 1. */
static void see(const struct calibration_eye *eye, double x, double y, double *u, double *v) {
    const double *k = eye->distortion, *m = eye->camera;
    double xx = x * x, yy = y * y, r2 = xx + yy, xy = 2 * x * y;
    double stretch = (1 + ((k[4] * r2 + k[1]) * r2 + k[0]) * r2) / (1 + ((k[7] * r2 + k[6]) * r2 + k[5]) * r2);
    double at_x = x * stretch + k[2] * xy + k[3] * (r2 + 2 * xx) + (k[8] + k[9] * r2) * r2;
    double at_y = y * stretch + k[2] * (r2 + 2 * yy) + k[3] * xy + (k[10] + k[11] * r2) * r2;

    *u = m[0] * at_x + m[1] * at_y + m[2];
    *v = m[4] * at_y + m[5];
}

/* The first of two neighbours along an axis of `count` pixels, and the share of the second; OUTSIDE: none. */
static int16_t neighbour(double at, int count, uint8_t *share) {
    if (!(at > -1 && at < count))
        return OUTSIDE;
    long parts = lrint(at * PARTS), first = parts / PARTS;
    if (parts < 0 || parts > (long)(count - 1) * PARTS)
        return OUTSIDE;
    first -= first == count - 1; /* the last pixel is the second neighbour, and has the whole share */
    *share = (uint8_t)(parts - first * PARTS);
    return (int16_t)first;
}

/* For pictures of at least 2x2. NULL: no memory. */
static struct rectifier *rectifier_new(const struct calibration *calibration, enum eye eye, int width, int height) {
    size_t pixels = (size_t)width * (size_t)height;
    struct rectifier *rectifier = malloc(sizeof *rectifier + pixels * sizeof *rectifier->place);
    double rays[9];

    if (!rectifier)
        return NULL;
    rectifier->width = width;
    rectifier->height = height;
    rays_of(calibration, eye, rays);
    for (size_t i = 0; i < pixels; i++) {
        struct place *place = &rectifier->place[i];
        double x = (double)(i % (size_t)width), y = (double)(i / (size_t)width), u, v;
        double depth = rays[6] * x + rays[7] * y + rays[8];

        see(&calibration->eye[eye], (rays[0] * x + rays[1] * y + rays[2]) / depth,
            (rays[3] * x + rays[4] * y + rays[5]) / depth, &u, &v);
        place->x = depth > 0 ? neighbour(u, width, &place->right) : OUTSIDE;
        place->y = neighbour(v, height, &place->below);
        if (place->y == OUTSIDE)
            place->x = OUTSIDE;
    }
    return rectifier;
}

static void rectifier_free(struct rectifier *rectifier) {
    free(rectifier);
}

/* Strides in bytes. `level`: a table for the samples. Points outside of the camera's picture become 0. */
static void rectifier_run(const struct rectifier *rectifier, const uint8_t *from, long from_stride,
                          const uint8_t level[256], uint8_t *to, long to_stride) {
    const struct place *place = rectifier->place;

    for (int y = 0; y < rectifier->height; y++, to += to_stride)
        for (int x = 0; x < rectifier->width; x++, place++) {
            if (place->x == OUTSIDE) {
                to[x] = 0;
                continue;
            }
            const uint8_t *above = from + place->y * from_stride + place->x, *below = above + from_stride;
            unsigned right = place->right, down = place->below, left = PARTS - right;
            unsigned sum =
                (above[0] * left + above[1] * right) * (PARTS - down) + (below[0] * left + below[1] * right) * down;

            to[x] = level[(sum + PARTS * PARTS / 2) / (PARTS * PARTS)];
        }
}

/* ---- Range ---- */

enum { RIGHT_ON_TOP, RANGE_BETWEEN, LEFT_BELOW, RANGE_FIELDS };
#define GREY 128 /* chroma without a colour */

static void ranger_close(struct ranger *ranger) {
    matcher_free(ranger->matcher);
    ranger->matcher = NULL;
    for (int i = 0; i < 2; i++) {
        rectifier_free(ranger->rectifier[i]);
        ranger->rectifier[i] = NULL;
    }
    DDX_STORE_ITEM **items[] = {&ranger->range, &ranger->disparity, &ranger->stereo};
    for (int i = 0; i < 3; i++) {
        ddx_store_done_item(*items[i]);
        *items[i] = NULL;
    }
    ranger->eye.width = 0;
}

/* ---- What is written ---- */

static struct ddxvideo_geometry range_geometry(const struct ddxvideo_geometry *eye) {
    struct ddxvideo_geometry geometry = *eye;

    geometry.height = RANGE_FIELDS * eye->height;
    geometry.fields = RANGE_FIELDS;
    geometry.format = DDX_VIDEO_420_JPEG;
    geometry.range = DDX_VIDEO_RANGE_FULL;
    geometry.interlacing = 'p';
    return geometry;
}

static struct ddxvideo_geometry disparity_geometry(const struct ddxvideo_geometry *eye) {
    struct ddxvideo_geometry geometry = *eye;

    geometry.fields = 1;
    geometry.format = DDX_VIDEO_GREY16;
    geometry.range = DDX_VIDEO_RANGE_UNKNOWN;
    geometry.interlacing = 'p';
    return geometry;
}

/* Writes the numbers that metres need: once, and again when the size of the pictures changes. */
static int write_stereo(struct ranger *ranger, DDX_STORE_ID *id) {
    const double *projection = ranger->calibration.eye[LEFT].projection;
    const DDX_VIDEO_STEREO stereo = {.f = projection[0],
                                     .T = ranger->calibration.baseline,
                                     .cx = projection[2],
                                     .cy = projection[6],
                                     .min = 1,
                                     .max = ranger->settings.disparities - 1,
                                     .step = 1.0 / MATCHER_SUBPIXEL};
    int error = ddxvideo_stereo_create(id, ranger->name, &ranger->stereo);

    return error ? error : ddx_store_write(ranger->stereo, &stereo, NULL);
}

static int create_items(struct ranger *ranger, DDX_STORE_ID *id) {
    const struct ddxvideo_geometry range = range_geometry(&ranger->eye), disparity = disparity_geometry(&ranger->eye);
    char name[DDX_NAME_MAX + 16];
    int error = ddxvideo_create(id, ranger->name, &range, &ranger->range);

    snprintf(name, sizeof name, "%s.disparity", ranger->name);
    if (!error)
        error = ddxvideo_create(id, name, &disparity, &ranger->disparity);
    return error ? error : write_stereo(ranger, id);
}

/* ---- Preparation, for pictures of this size ---- */

/* False, after a line for the first such picture, if pictures of this size have no range. */
static bool is_possible(struct ranger *ranger, const struct ddxvideo_geometry *eye) {
    const struct ddxvideo_geometry range = range_geometry(eye);
    const char *wrong = ddxvideo_geometry_error(&range);
    int width = eye->width, height = eye->height;

    if (ranger->refused)
        ;
    else if (width < MATCHER_LEAST_WIDTH || height < MATCHER_LEAST_HEIGHT || width < ranger->settings.disparities)
        say("pictures of %dx%d are too small for %d disparities", width, height, ranger->settings.disparities);
    else if (!calibration_fits(&ranger->calibration, width, height) && ranger->calibration.width)
        say("%s: is for pictures of %dx%d, and these are %dx%d", ranger->calibration_path, ranger->calibration.width,
            ranger->calibration.height, width, height);
    else if (!calibration_fits(&ranger->calibration, width, height))
        say("%s: is not for pictures of %dx%d: its centres lie outside", ranger->calibration_path, width, height);
    else if (wrong)
        say("pictures of %dx%d: three of them do not fit into a picture of 4:2:0: %s", width, height, wrong);
    else
        return true;
    ranger->refused = true;
    return false;
}

static int prepare(struct ranger *ranger, DDX_STORE_ID *id, const struct ddxvideo_geometry *eye) {
    if (ranger->eye.width && ddxvideo_same_layout(&ranger->eye, eye)) {
        ranger->refused = false;
        return 0;
    }
    if (!is_possible(ranger, eye))
        return -EINVAL;
    ranger_close(ranger);
    ranger->settings.width = eye->width;
    ranger->settings.height = eye->height;
    for (int i = 0; i < 2; i++)
        ranger->rectifier[i] = rectifier_new(&ranger->calibration, (enum eye)i, eye->width, eye->height);
    ranger->matcher = matcher_new(&ranger->settings);
    if (!ranger->rectifier[LEFT] || !ranger->rectifier[RIGHT] || !ranger->matcher)
        return -ENOMEM;
    luma_levels(eye->range, ranger->level);
    ranger->eye = *eye;
    int error = create_items(ranger, id);
    if (!error)
        say("range of %dx%d, %d disparities, %s; %.3g to %.3g units of the calibration", eye->width, eye->height,
            ranger->settings.disparities, matcher_variant(ranger->matcher),
            ranger->calibration.eye[LEFT].projection[0] * ranger->calibration.baseline /
                (ranger->settings.disparities - 1),
            ranger->calibration.eye[LEFT].projection[0] * ranger->calibration.baseline);
    ranger->refused = false;
    return error;
}

/* ---- Each pair ---- */

/* Near is bright; 0 is unknown. */
static void draw_range(const struct ranger *ranger, const uint16_t *disparity, uint8_t *to, int stride) {
    unsigned most = (unsigned)(ranger->settings.disparities - 1) * MATCHER_SUBPIXEL;

    for (int y = 0; y < ranger->eye.height; y++, to += stride)
        for (int x = 0; x < ranger->eye.width; x++) {
            unsigned value = *disparity++;

            to[x] = (uint8_t)(value ? 1 + value * 254 / most : 0);
        }
}

static void fill(const struct ranger *ranger, const struct pair *pair, struct ddxvideo_frame *range,
                 struct ddxvideo_frame *disparity) {
    long field = (long)range->stride[0] * ranger->eye.height;
    uint8_t *right = range->plane[0] + RIGHT_ON_TOP * field, *left = range->plane[0] + LEFT_BELOW * field;
    uint16_t *found = (uint16_t *)(void *)disparity->plane[0];

    rectifier_run(ranger->rectifier[LEFT], pair->luma[LEFT], pair->stride[LEFT], ranger->level, left, range->stride[0]);
    rectifier_run(ranger->rectifier[RIGHT], pair->luma[RIGHT], pair->stride[RIGHT], ranger->level, right,
                  range->stride[0]);
    matcher_run(ranger->matcher, left, range->stride[0], right, range->stride[0], found);
    draw_range(ranger, found, range->plane[0] + RANGE_BETWEEN * field, range->stride[0]);
    for (int plane = 1; plane < 3; plane++)
        memset(range->plane[plane], GREY, (size_t)range->stride[plane] * (size_t)range->rows[plane]);
}

/*
 * 0; -EINVAL: the pair does not fit the calibration or the method, after a line for the first such pair; otherwise an
 * error of the store or of memory, which is final except for -ENOBUFS (readers hold all slots).
 */
static int ranger_run(struct ranger *ranger, DDX_STORE_ID *id, const struct pair *pair) {
    struct ddxvideo_frame range, disparity;
    int error = prepare(ranger, id, &pair->geometry);

    if (error)
        return error;
    const struct ddxvideo_geometry of_range = range_geometry(&pair->geometry);
    const struct ddxvideo_geometry of_disparity = disparity_geometry(&pair->geometry);
    error = ddxvideo_loan(ranger->range, &of_range, &range);
    if (error)
        return error;
    error = ddxvideo_loan(ranger->disparity, &of_disparity, &disparity);
    if (!error) {
        fill(ranger, pair, &range, &disparity);
        range.stamp = disparity.stamp = pair->stamp;
        error = ddxvideo_publish(ranger->disparity, &disparity);
    }
    if (!error)
        return ddxvideo_publish(ranger->range, &range);
    ddx_store_cancel(ranger->range);
    return error;
}

/* ---- Program ---- */

#define WAIT 0.1 /* s; a signal does not end a wait, so waits are short */

static const char *const reasons[] = {"late", "pair", "picture", "store", NULL};

struct svs {
    struct program program;
    struct source source;
    struct ranger ranger;
    DDX_STORE_ID *id;
    bool failed;
};

static void fail(struct svs *svs, const char *item, int error) {
    say("%s: %s", item, ddx_error_text(error));
    svs->failed = true;
}

/* Both eyes must have the same size; of a series of pairs that differ, the first is reported. */
static bool is_pair(struct svs *svs) {
    const struct source *source = &svs->source;
    const struct ddxvideo_geometry *left = &source->item[LEFT].picture.geometry;
    const struct ddxvideo_geometry *right = &source->item[RIGHT].picture.geometry;

    if (source->items == 1 && left->fields == 2)
        return true;
    if (source->items == 2 && left->width == right->width && left->height == right->height)
        return true;
    if (!svs->ranger.refused && source->items == 1)
        say("%s: has %d fields, not the two of a stereo pair", source->name[0], left->fields);
    else if (!svs->ranger.refused)
        say("%s has pictures of %dx%d, %s has %dx%d: both must have the same size", source->name[0], left->width,
            left->height, source->name[1], right->width, right->height);
    svs->ranger.refused = true;
    return false;
}

static void handle(struct svs *svs, const struct pair *pair) {
    DDX_STATS_BOOK *book = svs->source.book;
    int error = is_pair(svs) ? ranger_run(&svs->ranger, svs->id, pair) : -EINVAL;

    if (!error)
        ddx_stats_out(book, pair->frames, ddx_time_now() - pair->written);
    else
        ddx_stats_lost(book, error == -EINVAL ? LOST_PICTURE : LOST_STORE, pair->frames);
    if (error && error != -EINVAL && error != -ENOBUFS)
        fail(svs, svs->ranger.name, error);
}

static void take_frames(struct svs *svs, double wait) {
    struct pair pair;
    const char *at;
    int error = source_take(&svs->source, wait, &pair, &at);

    if (!error) {
        handle(svs, &pair);
        source_give(&svs->source);
    } else if (error != -EAGAIN) {
        fail(svs, at, error);
    }
    ddx_stats_write(svs->source.book);
}

static int run(struct svs *svs) {
    svs->source.book = program_book(&svs->program, reasons);
    svs->id = program_connect(&svs->program);
    const char *single = svs->source.name[1] ? NULL : svs->source.name[0];
    if (svs->id && program_attach(&svs->program, svs->source.book, svs->id, single) &&
        source_open(&svs->source, svs->id)) {
        for (; !program_stopping() && !svs->failed; program_tick(svs->source.book))
            take_frames(svs, WAIT);
        if (!svs->failed)
            take_frames(svs, 0); /* frames that were written before the stop */
    } else if (svs->id && !program_stopping()) {
        svs->failed = true;
    }
    source_end(&svs->source);
    program_report(svs->source.book);
    if (svs->failed)
        ddx_stats_fail(svs->source.book);
    ddx_stats_close(svs->source.book);
    ranger_close(&svs->ranger);
    source_close(&svs->source);
    ddx_store_close(svs->id);
    return svs->failed ? EXIT_FAILED : EXIT_OK;
}

/* The options as text. */
struct words {
    const char *from, *left, *right, *top;
    long disparities, window;
};

/* Exits after a line if they are wrong. */
static void understand(struct svs *svs, const struct words *words) {
    char error[CALIBRATION_ERROR_MAX];

    if (words->from && (words->left || words->right))
        program_bad_usage("-from is one item with both eyes, -left and -right are two: give one or the other");
    if (!words->left != !words->right)
        program_bad_usage("-left and -right go together");
    svs->source.name[0] = words->left ? words->left : words->from ? words->from : "video";
    svs->source.name[1] = words->right;
    if (words->right && !strcmp(words->left, words->right))
        program_bad_usage("-left and -right are the same item");
    svs->source.top = strcmp(words->top, "left") ? RIGHT : LEFT;
    if (svs->source.top == RIGHT && strcmp(words->top, "right") != 0)
        program_bad_usage("-top %s: left or right is needed", words->top);
    if (words->disparities % 16)
        program_bad_usage("-disparities %ld: a multiple of 16 is needed, from 16 to 256", words->disparities);
    if (!svs->ranger.calibration_path)
        program_bad_usage("-calib is missing");
    if (!calibration_read(&svs->ranger.calibration, svs->ranger.calibration_path, error)) {
        say("%s", error);
        exit(EXIT_USAGE);
    }
    svs->ranger.settings = (struct matcher_settings){
        .disparities = (int)words->disparities, .uniqueness = 5, .agreement = 1, .speckle = 50};
    svs->source.window = words->window * MS;
}

int main(int argc, char **argv) {
    static struct svs svs = {.ranger = {.name = "range"}};
    struct words words = {.top = "left", .disparities = 64};
    const struct option_entry options[] = {
        {"from", "ITEM", "video item with two stacked fields, one of each eye (default: video)", OPTION_NAME,
         &words.from, 0, 0},
        {"left", "ITEM", "the left camera's video item, instead of -from", OPTION_NAME, &words.left, 0, 0},
        {"right", "ITEM", "the right camera's video item", OPTION_NAME, &words.right, 0, 0},
        {"calib", "FILE", "calibration in OpenCV's YAML, as ddxvideocalib writes it", OPTION_TEXT,
         &svs.ranger.calibration_path, 0, 0},
        {"name", "ITEM", "the video item to write (default: range)", OPTION_NAME, &svs.ranger.name, 0,
         DDX_NAME_MAX - (long)sizeof ".disparity" + 1},
        {"disparities", "N", "number of disparities, 0 to N - 1 pixels, a multiple of 16 (default: 64)", OPTION_NUMBER,
         &words.disparities, 16, 256},
        {"top", "left|right", "which eye the upper field of -from is (default: left)", OPTION_TEXT, &words.top, 0, 0},
        {"window", "MS", "maximum difference of times in a pair (default: half a frame period)", OPTION_NUMBER,
         &words.window, 1, 10000},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    svs.program = (struct program){
        .name = "ddxvideoSVS",
        .purpose = "Range from a stereo pair. Writes a video item of three fields (the right picture, the range\n"
                   "picture, in which near is bright and 0 is unknown, and the left picture, both rectified), item\n"
                   "`<name>.disparity` (GREY16, 1/16 pixel, 0 is unknown) and item `<name>.stereo`:\n"
                   "distance = f * T / disparity. The newest pair is taken; a pair that comes while another one is\n"
                   "matched is lost if a newer one comes first.",
        .notes = "Frame number and time are the pair's; of two items, the left one's. Counters of the input's frames:\n"
                 "lost.late = a newer frame came first, lost.pair = the other camera has no frame of that time,\n"
                 "lost.picture = does not fit the calibration or the other camera, lost.store = could not be written\n"
                 "into the store.",
        .options = options,
    };
    program_start(&svs.program, argc, argv);
    understand(&svs, &words);
    return svs.program.check ? EXIT_OK : run(&svs);
}
