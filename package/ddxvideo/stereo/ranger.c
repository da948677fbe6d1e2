/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "ranger.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

enum { RIGHT_ON_TOP, RANGE_BETWEEN, LEFT_BELOW, RANGE_FIELDS };
#define GREY 128 /* chroma without a colour */

void ranger_close(struct ranger *ranger) {
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
    const DDX_VIDEO_STEREO stereo = {.f = projection[0], .T = ranger->calibration.baseline, .cx = projection[2],
                                     .cy = projection[6], .min = 1, .max = ranger->settings.disparities - 1,
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
static bool possible(struct ranger *ranger, const struct ddxvideo_geometry *eye) {
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
    if (!possible(ranger, eye))
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

    rectifier_run(ranger->rectifier[LEFT], pair->luma[LEFT], pair->stride[LEFT], ranger->level, left,
                  range->stride[0]);
    rectifier_run(ranger->rectifier[RIGHT], pair->luma[RIGHT], pair->stride[RIGHT], ranger->level, right,
                  range->stride[0]);
    matcher_run(ranger->matcher, left, range->stride[0], right, range->stride[0], found);
    draw_range(ranger, found, range->plane[0] + RANGE_BETWEEN * field, range->stride[0]);
    for (int plane = 1; plane < 3; plane++)
        memset(range->plane[plane], GREY, (size_t)range->stride[plane] * (size_t)range->rows[plane]);
}

int ranger_run(struct ranger *ranger, DDX_STORE_ID *id, const struct pair *pair) {
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
