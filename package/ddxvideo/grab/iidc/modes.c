/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "modes.h"

#include <strings.h>

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

int mode_merit(dc1394color_coding_t coding) {
    const struct coding *found = find_coding(coding);

    return found ? found->merit : 0;
}

static enum pixels_coding of_pattern(dc1394color_filter_t bayer, bool two_bytes) {
    for (unsigned i = 0; i < COUNT(patterns); i++)
        if (patterns[i].bayer == bayer)
            return two_bytes ? patterns[i].of16 : patterns[i].of8;
    return PIXELS_NONE;
}

enum pixels_coding mode_pixels(dc1394color_coding_t coding, dc1394color_filter_t bayer) {
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
