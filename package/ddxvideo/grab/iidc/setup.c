/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "setup.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "format7.h"
#include "fraction.h"
#include "modes.h"

#define FULL_DEPTH 16
#define SAME_SAMPLES 100
#define SMALLER (INT64_C(1) << 40) /* a picture that must be enlarged counts as farther away than any larger picture */

/* Distance of a mode's picture from the requested size; without one, the largest is the nearest. */
static int64_t distance(const struct setup_wish *wish, uint32_t width, uint32_t height) {
    int64_t area = (int64_t)width * height, wanted = (int64_t)wish->width * wish->height;

    if (!wish->width)
        return -area;
    bool covers = width >= (uint32_t)wish->width && height >= (uint32_t)wish->height;
    return covers ? area - wanted : SMALLER - area;
}

/* Prefers codings with the layout's own samples. */
static int merit_of(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish) {
    dc1394color_coding_t coding;

    if (mode == DC1394_VIDEO_MODE_EXIF || dc1394_is_video_mode_scalable(mode) ||
        dc1394_get_color_coding_from_video_mode(device, mode, &coding) != DC1394_SUCCESS)
        return 0;
    int layout = wish->layout->format;
    const struct pixels_format *format = pixels_find(mode_pixels(coding, wish->bayer));
    bool same = !video_layout_is_420(layout) && format && format->layout == layout;
    return mode_merit(coding) + (same ? SAME_SAMPLES : 0);
}

/* The mode with the nearest pictures, in the best coding; 0: there is no fixed mode. */
static dc1394video_mode_t nearest(dc1394camera_t *device, const dc1394video_modes_t *modes,
                                  const struct setup_wish *wish) {
    dc1394video_mode_t best = 0;
    int64_t best_distance = INT64_MAX;
    int best_merit = 0;

    for (unsigned i = 0; i < modes->num && i < DC1394_VIDEO_MODE_NUM; i++) {
        uint32_t width, height;
        int merit = merit_of(device, modes->modes[i], wish);

        if (!merit || dc1394_get_image_size_from_video_mode(device, modes->modes[i], &width, &height))
            continue;
        int64_t now = distance(wish, width, height);
        if (now < best_distance || (now == best_distance && merit > best_merit)) {
            best = modes->modes[i];
            best_distance = now;
            best_merit = merit;
        }
    }
    return best;
}

static bool offers(const dc1394video_modes_t *modes, dc1394video_mode_t mode) {
    for (unsigned i = 0; i < modes->num && i < DC1394_VIDEO_MODE_NUM; i++)
        if (modes->modes[i] == mode)
            return true;
    return false;
}

static int choose_mode(dc1394camera_t *device, const struct setup_wish *wish, dc1394video_mode_t *mode, char *why,
                       size_t size) {
    dc1394video_modes_t modes = {.num = 0};

    if (dc1394_video_get_supported_modes(device, &modes)) {
        snprintf(why, size, "does not answer");
        return -EIO;
    }
    if (wish->mode) {
        *mode = wish->mode;
        if (offers(&modes, *mode))
            return 0;
        snprintf(why, size, "has no mode %s; ddxvideo1394 -list shows those that it has", mode_name(*mode));
        return -EINVAL;
    }
    if (!wish->width && !dc1394_video_get_mode(device, mode) && offers(&modes, *mode) && merit_of(device, *mode, wish))
        return 0;
    *mode = nearest(device, &modes, wish);
    if (!*mode && offers(&modes, DC1394_VIDEO_MODE_FORMAT7_0))
        *mode = DC1394_VIDEO_MODE_FORMAT7_0;
    if (*mode)
        return 0;
    snprintf(why, size, "has no mode that is known here");
    return -EINVAL;
}

/* The slowest rate that is fast enough, or the fastest. */
static int set_rate(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish,
                    struct ddxvideo_geometry *geometry) {
    dc1394framerates_t rates = {.num = 0};
    int num, den;

    if (dc1394_video_get_supported_framerates(device, mode, &rates) || !rates.num)
        return -EIO;
    dc1394framerate_t chosen = rates.framerates[0];
    for (unsigned i = 0; i < rates.num && i < DC1394_FRAMERATE_NUM; i++) { /* from slow to fast */
        mode_rate(chosen, &num, &den);
        if (wish->rate > 0 && (double)num / den + 0.001 >= wish->rate)
            break;
        chosen = rates.framerates[i];
    }
    mode_rate(chosen, &geometry->rate_num, &geometry->rate_den);
    return dc1394_video_set_framerate(device, chosen) ? -EIO : 0;
}

/* Reads the rate from the feature, which is more exact, if the camera has it. */
static void take_true_rate(dc1394camera_t *device, struct ddxvideo_geometry *geometry) {
    dc1394feature_info_t rate = {.id = DC1394_FEATURE_FRAME_RATE};
    int num, den;

    if (dc1394_feature_get(device, &rate) || !rate.available || !rate.is_on || !rate.absolute_capable ||
        !(rate.abs_value > 0.01F && rate.abs_value < DDX_VIDEO_RATE))
        return;
    fraction_set(&num, &den, (int64_t)((double)rate.abs_value * 1000 + 0.5), 1000);
    if (!ddxvideo_rate_known(num, den))
        return;
    geometry->rate_num = num;
    geometry->rate_den = den;
}

static int take_pixels(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish,
                       struct setup *setup, char *why, size_t size) {
    dc1394color_coding_t coding;
    dc1394color_filter_t bayer = wish->bayer;
    uint32_t width, height, depth = 0, bits = 0;

    if (dc1394_get_color_coding_from_video_mode(device, mode, &coding) ||
        dc1394_get_image_size_from_video_mode(device, mode, &width, &height) ||
        dc1394_get_color_coding_bit_size(coding, &bits)) {
        snprintf(why, size, "does not report what it sends");
        return -EIO;
    }
    bool raw = coding == DC1394_COLOR_CODING_RAW8 || coding == DC1394_COLOR_CODING_RAW16;
    if (raw && !bayer && format7_bayer(device, mode, &bayer)) {
        snprintf(why, size, "does not report its Bayer pattern; -bayer is needed");
        return -EINVAL;
    }
    enum pixels_coding pixels = mode_pixels(coding, bayer);
    if (!pixels || width < 2 || height < 2 || width > DDX_VIDEO_SIDE || height > DDX_VIDEO_SIDE ||
        (coding == DC1394_COLOR_CODING_YUV411 && width % 4)) {
        snprintf(why, size, "its pictures (%ux%u) are not of a kind that is known here", width, height);
        return -EINVAL;
    }
    dc1394_video_get_data_depth(device, &depth);
    const struct pixels_format *format = pixels_find(pixels);
    setup->pixels = (struct pixels){.coding = pixels,
                                    .width = (int)width,
                                    .height = (int)height,
                                    .stride = (int)(width * bits / 8),
                                    .depth = depth > 8 && depth < FULL_DEPTH ? (int)depth : FULL_DEPTH};
    setup->eight_bits = format->unpack != UNPACK_16;
    bool made_of_rgb = format->libav == AV_PIX_FMT_RGB24 || (bayer && mode_pixels(coding, 0) != pixels);
    setup->geometry.width = (int)width;
    setup->geometry.height = (int)height;
    setup->geometry.range = made_of_rgb ? DDX_VIDEO_RANGE_LIMITED : DDX_VIDEO_RANGE_FULL;
    return 0;
}

int setup_camera(dc1394camera_t *device, const struct setup_wish *wish, struct setup *setup, char *why, size_t size) {
    const char *platform = "";
    dc1394video_mode_t mode;

    *setup = (struct setup){.geometry = {.fields = 1, .interlacing = 'p', .aspect_num = 1, .aspect_den = 1}};
    if (dc1394_video_set_transmission(device, DC1394_OFF)) {
        snprintf(why, size, "does not answer");
        return -EIO;
    }
    int error = choose_mode(device, wish, &mode, why, size);
    if (error)
        return error;
    dc1394_camera_get_platform_string(device, &platform);
    bool firewire = strcmp(platform, "usb") != 0;
    if (firewire) /* some cameras start with 100 */
        dc1394_video_set_iso_speed(device, DC1394_ISO_SPEED_400);
    if (dc1394_video_set_mode(device, mode))
        error = -EIO;
    else if (dc1394_is_video_mode_scalable(mode))
        error = format7_set(device, mode, wish, firewire, &setup->geometry, why, size);
    else
        error = set_rate(device, mode, wish, &setup->geometry);
    if (error) {
        if (!*why)
            snprintf(why, size, "does not accept mode %s", mode_name(mode));
        return error;
    }
    take_true_rate(device, &setup->geometry);
    return take_pixels(device, mode, wish, setup, why, size);
}
