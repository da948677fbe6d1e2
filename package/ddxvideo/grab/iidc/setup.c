/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "setup.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "fraction.h"

/* ---- Names and numbers of modes, codings and rates ---- */

#define COUNT(array) (sizeof(array) / sizeof *(array))

static const struct {
    const char *name;
    dc1394video_mode_t mode;
} modes[] = {
#define MODE(size_coding) \
    { #size_coding, DC1394_VIDEO_MODE_##size_coding }
    MODE(160x120_YUV444),  MODE(320x240_YUV422),  MODE(640x480_YUV411),   MODE(640x480_YUV422),  MODE(640x480_RGB8),
    MODE(640x480_MONO8),   MODE(640x480_MONO16),  MODE(800x600_YUV422),   MODE(800x600_RGB8),    MODE(800x600_MONO8),
    MODE(800x600_MONO16),  MODE(1024x768_YUV422), MODE(1024x768_RGB8),    MODE(1024x768_MONO8),  MODE(1024x768_MONO16),
    MODE(1280x960_YUV422), MODE(1280x960_RGB8),   MODE(1280x960_MONO8),   MODE(1280x960_MONO16), MODE(1600x1200_YUV422),
    MODE(1600x1200_RGB8),  MODE(1600x1200_MONO8), MODE(1600x1200_MONO16), MODE(FORMAT7_0),       MODE(FORMAT7_1),
    MODE(FORMAT7_2),       MODE(FORMAT7_3),       MODE(FORMAT7_4),        MODE(FORMAT7_5),       MODE(FORMAT7_6),
    MODE(FORMAT7_7),
#undef MODE
};

/* Name, and order of choice without -mode: colour as in the store, colour made of RGB, no colour. */
static const struct coding {
    const char *name;
    dc1394color_coding_t coding;
    int merit;
    enum pixels_coding pixels;
} codings[] = {
    {"YUV422", DC1394_COLOR_CODING_YUV422, 8, PIXELS_UYVY},   {"YUV411", DC1394_COLOR_CODING_YUV411, 7, PIXELS_YUV411},
    {"YUV444", DC1394_COLOR_CODING_YUV444, 6, PIXELS_YUV444}, {"RGB8", DC1394_COLOR_CODING_RGB8, 5, PIXELS_RGB24},
    {"MONO8", DC1394_COLOR_CODING_MONO8, 4, PIXELS_GREY},     {"MONO16", DC1394_COLOR_CODING_MONO16, 3, PIXELS_GREY16},
    {"RAW8", DC1394_COLOR_CODING_RAW8, 2, PIXELS_GREY},       {"RAW16", DC1394_COLOR_CODING_RAW16, 1, PIXELS_GREY16},
    {"RGB16", DC1394_COLOR_CODING_RGB16, 1, PIXELS_RGB48},
};

static const struct {
    const char *name;
    dc1394color_filter_t bayer;
    enum pixels_coding of8, of16;
} patterns[] = {
    {"RGGB", DC1394_COLOR_FILTER_RGGB, PIXELS_RGGB, PIXELS_RGGB16},
    {"GBRG", DC1394_COLOR_FILTER_GBRG, PIXELS_GBRG, PIXELS_GBRG16},
    {"GRBG", DC1394_COLOR_FILTER_GRBG, PIXELS_GRBG, PIXELS_GRBG16},
    {"BGGR", DC1394_COLOR_FILTER_BGGR, PIXELS_BGGR, PIXELS_BGGR16},
};

bool mode_parse(const char *text, dc1394video_mode_t *mode) {
    for (unsigned i = 0; i < COUNT(modes); i++) {
        if (!strcasecmp(text, modes[i].name)) {
            *mode = modes[i].mode;
            return true;
        }
    }
    return false;
}

bool mode_parse_coding(const char *text, dc1394color_coding_t *coding) {
    for (unsigned i = 0; i < COUNT(codings); i++) {
        if (!strcasecmp(text, codings[i].name)) {
            *coding = codings[i].coding;
            return true;
        }
    }
    return false;
}

bool mode_parse_bayer(const char *text, dc1394color_filter_t *bayer) {
    for (unsigned i = 0; i < COUNT(patterns); i++) {
        if (!strcasecmp(text, patterns[i].name)) {
            *bayer = patterns[i].bayer;
            return true;
        }
    }
    return false;
}

const char *mode_name(dc1394video_mode_t mode) {
    for (unsigned i = 0; i < COUNT(modes); i++)
        if (modes[i].mode == mode)
            return modes[i].name;
    return "a mode that is not known here";
}

static const struct coding *find_coding(dc1394color_coding_t coding) {
    for (unsigned i = 0; i < COUNT(codings); i++)
        if (codings[i].coding == coding)
            return &codings[i];
    return NULL;
}

const char *mode_coding_name(dc1394color_coding_t coding) {
    const struct coding *found = find_coding(coding);

    return found ? found->name : NULL;
}

/* How well a coding suits without -mode; 0: not at all. */
static int mode_merit(dc1394color_coding_t coding) {
    const struct coding *found = find_coding(coding);

    return found ? found->merit : 0;
}

static enum pixels_coding of_pattern(dc1394color_filter_t bayer, bool two_bytes) {
    for (unsigned i = 0; i < COUNT(patterns); i++)
        if (patterns[i].bayer == bayer)
            return two_bytes ? patterns[i].of16 : patterns[i].of8;
    return PIXELS_NONE;
}

/* The pixel format of a coding in memory. `bayer`: the sensor's pattern; 0: none. */
static enum pixels_coding mode_pixels(dc1394color_coding_t coding, dc1394color_filter_t bayer) {
    const struct coding *found = find_coding(coding);

    if (!found)
        return PIXELS_NONE;
    bool two_bytes = found->pixels == PIXELS_GREY16, grey = found->pixels == PIXELS_GREY || two_bytes;
    return grey && bayer ? of_pattern(bayer, two_bytes) : found->pixels;
}

void mode_rate(dc1394framerate_t rate, int *num, int *den) {
    int eighths = 15 << (rate - DC1394_FRAMERATE_MIN); /* 1.875; each rate is twice the previous one */

    for (*den = 8; *den > 1 && eighths % 2 == 0; *den /= 2)
        eighths /= 2;
    *num = eighths;
}

/* ---- FORMAT7 ---- */

/* Any part of the picture, in one of several codings; the size of the packets sets the rate. */

#define FRAME_INTERVAL_INQ 0x50 /* the library reads this as a whole number, but it is a float */
#define COLOR_FILTER_ID 0x58
#define BAYER_TILE_MAPPING 0x1040 /* as four letters, from Point Grey */
#define PACKETS_PER_SECOND 8000

static int choose_coding(dc1394camera_t *device, dc1394video_mode_t mode, dc1394color_coding_t wanted,
                         dc1394color_coding_t *coding, char *why, size_t size) {
    dc1394color_codings_t codings = {.num = 0};
    dc1394color_coding_t best = 0;

    if (dc1394_format7_get_color_codings(device, mode, &codings))
        return -EIO;
    dc1394_format7_get_color_coding(device, mode, coding);
    for (unsigned i = 0; i < codings.num && i < DC1394_COLOR_CODING_NUM; i++) {
        dc1394color_coding_t one = codings.codings[i];

        if (wanted ? one == wanted : one == *coding && mode_merit(one)) {
            *coding = one;
            return 0;
        }
        if (mode_merit(one) > mode_merit(best))
            best = one;
    }
    *coding = best;
    if (!wanted && best)
        return 0;
    snprintf(why, size, "%s has no coding %s; ddxvideo1394 -list shows those that it has", mode_name(mode),
             wanted ? mode_coding_name(wanted) : "that is known here");
    return -EINVAL;
}

/* Reports the sensor's sizes, since the library does not report what was wrong. */
static int refuse_roi(dc1394camera_t *device, dc1394video_mode_t mode, char *why, size_t size) {
    uint32_t width = 0, height = 0, unit_x = 0, unit_y = 0, at_x = 0, at_y = 0;

    if (dc1394_format7_get_max_image_size(device, mode, &width, &height) ||
        dc1394_format7_get_unit_size(device, mode, &unit_x, &unit_y) ||
        dc1394_format7_get_unit_position(device, mode, &at_x, &at_y))
        return -EIO;
    snprintf(why, size, "-roi: this camera's %s has %ux%u, in steps of %ux%u, at steps of %ux%u", mode_name(mode),
             width, height, unit_x, unit_y, at_x, at_y);
    return -EINVAL;
}

static bool roi_fits(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish) {
    uint32_t width = 0, height = 0, unit_x = 0, unit_y = 0, at_x = 0, at_y = 0;

    if (!wish->roi_width)
        return true;
    dc1394_format7_get_max_image_size(device, mode, &width, &height);
    dc1394_format7_get_unit_size(device, mode, &unit_x, &unit_y);
    dc1394_format7_get_unit_position(device, mode, &at_x, &at_y);
    return wish->left + wish->roi_width <= (int64_t)width && wish->top + wish->roi_height <= (int64_t)height &&
           unit_x && unit_y && (uint32_t)wish->roi_width % unit_x == 0 && (uint32_t)wish->roi_height % unit_y == 0 &&
           (!at_x || (uint32_t)wish->left % at_x == 0) && (!at_y || (uint32_t)wish->top % at_y == 0);
}

/* Chooses the smallest packets that are fast enough, so that other cameras get bandwidth. */
static int set_packets(dc1394camera_t *device, dc1394video_mode_t mode, dc1394color_coding_t coding, double rate) {
    uint32_t width, height, bits, unit = 0, greatest = 0;

    if (dc1394_format7_get_image_size(device, mode, &width, &height) ||
        dc1394_get_color_coding_bit_size(coding, &bits) ||
        dc1394_format7_get_packet_parameters(device, mode, &unit, &greatest) || !unit)
        return -EIO;
    double wanted = (double)width * height * bits / 8 * rate / PACKETS_PER_SECOND;
    if (!(wanted < greatest))
        return 0;
    uint32_t packet = ((uint32_t)wanted / unit + 1) * unit;
    return packet < greatest && dc1394_format7_set_packet_size(device, mode, packet) ? -EIO : 0;
}

static void take_rate(dc1394camera_t *device, dc1394video_mode_t mode, bool firewire,
                      struct ddxvideo_geometry *geometry) {
    uint32_t bits = 0, packets = 0;
    float interval = 0;
    int num = 0, den = 0;

    if (!dc1394_get_format7_register(device, mode, FRAME_INTERVAL_INQ, &bits))
        memcpy(&interval, &bits, sizeof interval);
    if (interval > 0.0001F && interval < 100)
        fraction_set(&num, &den, (int64_t)(1000 / (double)interval + 0.5), 1000);
    else if (firewire && !dc1394_format7_get_packets_per_frame(device, mode, &packets) && packets)
        fraction_set(&num, &den, PACKETS_PER_SECOND, packets);
    if (!num || !ddxvideo_rate_known(num, den))
        return;
    geometry->rate_num = num;
    geometry->rate_den = den;
}

/* Set coding, part of the picture, size of packets. Fills the geometry's rate, if it is known. As setup_camera(). */
static int format7_set(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish, bool firewire,
                       struct ddxvideo_geometry *geometry, char *why, size_t size) {
    dc1394color_coding_t coding = 0;
    int error = choose_coding(device, mode, wish->coding, &coding, why, size);

    if (error)
        return error;
    if (!roi_fits(device, mode, wish) ||
        dc1394_format7_set_roi(device, mode, coding, DC1394_USE_MAX_AVAIL, wish->left, wish->top,
                               wish->roi_width ? wish->roi_width : DC1394_USE_MAX_AVAIL,
                               wish->roi_height ? wish->roi_height : DC1394_USE_MAX_AVAIL))
        return wish->roi_width ? refuse_roi(device, mode, why, size) : -EIO;
    if (wish->rate > 0)
        error = set_packets(device, mode, coding, wish->rate);
    take_rate(device, mode, firewire, geometry);
    return error;
}

/* The sensor's Bayer pattern. -ENODATA: the camera does not report it. */
static int format7_bayer(dc1394camera_t *device, dc1394video_mode_t mode, dc1394color_filter_t *bayer) {
    uint32_t value = 0;
    char letters[5] = "";

    if (device->vendor_id == 0xb09d && !dc1394_get_control_register(device, BAYER_TILE_MAPPING, &value)) {
        for (int i = 0; i < 4; i++)
            letters[i] = (char)(value >> (24 - 8 * i) & 0xff);
        if (mode_parse_bayer(letters, bayer))
            return 0;
    }
    /* IIDC has this register since version 1.31. */
    if (device->iidc_version < DC1394_IIDC_VERSION_1_31 ||
        dc1394_get_format7_register(device, mode, COLOR_FILTER_ID, &value) || value >> 24 >= DC1394_COLOR_FILTER_NUM)
        return -ENODATA;
    *bayer = DC1394_COLOR_FILTER_MIN + (value >> 24);
    return 0;
}

/* ---- Setup ---- */

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

static bool has_mode(const dc1394video_modes_t *modes, dc1394video_mode_t mode) {
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
        if (has_mode(&modes, *mode))
            return 0;
        snprintf(why, size, "has no mode %s; ddxvideo1394 -list shows those that it has", mode_name(*mode));
        return -EINVAL;
    }
    if (!wish->width && !dc1394_video_get_mode(device, mode) && has_mode(&modes, *mode) &&
        merit_of(device, *mode, wish))
        return 0;
    *mode = nearest(device, &modes, wish);
    if (!*mode && has_mode(&modes, DC1394_VIDEO_MODE_FORMAT7_0))
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
