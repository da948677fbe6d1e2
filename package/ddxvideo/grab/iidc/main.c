/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideo1394: grabs from an IIDC camera, on FireWire or USB, into the store. */
#include <libavutil/log.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "grabber.h"
#include "iidc_camera.h"
#include "setup.h"
#include "geometry.h"

#define FASTEST 1000 /* -rate, frames per second */

/* The options as text. */
struct words {
    const char *camera, *size, *mode, *format, *roi, *rate, *bayer, *layout;
};

/* "X,Y,WIDTH,HEIGHT"; even sides, as of all 4:2:0 pictures in the store. */
static bool parse_roi(const char *text, struct setup_wish *wish) {
    int end = 0;
    bool digits = strspn(text, "0123456789,") == strlen(text) && strlen(text) < sizeof "8192,8192,8192,8192";

    return digits &&
           sscanf(text, "%d,%d,%d,%d%n", &wish->left, &wish->top, &wish->roi_width, &wish->roi_height, &end) == 4 &&
           !text[end] && wish->roi_width > 0 && wish->roi_height > 0 && wish->roi_width % 2 == 0 &&
           wish->roi_height % 2 == 0;
}

static bool parse_rate(const char *text, double *rate) {
    char *end;

    *rate = strtod(text, &end);
    return end != text && !*end && *rate > 0 && *rate <= FASTEST;
}

/* Options of FORMAT7 only. Exits after a line if they are wrong. */
static void understand_format7(struct setup_wish *wish, const struct words *words) {
    if (words->format && !mode_parse_coding(words->format, &wish->coding))
        program_bad_usage("-format %s: one of %s is needed", words->format, CODING_NAMES);
    if (words->roi && !parse_roi(words->roi, wish))
        program_bad_usage("-roi %s: four numbers X,Y,W,H are needed, with an even width and height", words->roi);
    if (!words->format && !words->roi)
        return;
    if (!wish->mode)
        wish->mode = DC1394_VIDEO_MODE_FORMAT7_0;
    if (!dc1394_is_video_mode_scalable(wish->mode))
        program_bad_usage("-%s: only the modes FORMAT7_0 to FORMAT7_7 leave a choice, not %s",
                          words->format ? "format" : "roi", mode_name(wish->mode));
}

/* Exits after a line if they are wrong. */
static void understand(struct iidc_camera *iidc, const struct words *words) {
    struct setup_wish *wish = &iidc->wish;

    if (!bus_parse(words->camera, &iidc->bus))
        program_bad_usage("-camera %s: a number or a GUID of 16 digits is needed; -list shows them", words->camera);
    snprintf(iidc->name, sizeof iidc->name, "camera %.17s", words->camera);
    if (words->size && !size_parse(words->size, &wish->width, &wish->height))
        program_bad_usage("-size %s: one of %s is needed", words->size, SIZE_NAMES);
    iidc->camera.width = wish->width;
    iidc->camera.height = wish->height;
    wish->layout = video_layout_named(words->layout);
    if (!wish->layout)
        program_bad_usage("-layout %s: " VIDEO_LAYOUT_NAMES " is needed", words->layout);
    iidc->camera.layout = wish->layout;
    if (words->mode && !mode_parse(words->mode, &wish->mode))
        program_bad_usage("-mode %s: unknown; there are %s; -list shows each camera's", words->mode, MODE_NAMES);
    if (words->rate && !parse_rate(words->rate, &wish->rate))
        program_bad_usage("-rate %s: a number above 0 and up to %d is needed", words->rate, FASTEST);
    if (words->bayer && !mode_parse_bayer(words->bayer, &wish->bayer))
        program_bad_usage("-bayer %s: one of %s is needed", words->bayer, BAYER_NAMES);
    understand_format7(wish, words);
}

int main(int argc, char **argv) {
    struct iidc_camera iidc;
    struct grabber grabber = {.name = "video", .skip = 1, .camera = &iidc.camera};
    struct words words = {.camera = "0", .layout = "YUV420P"};
    bool list = false;
    const struct option_entry options[] = {
        {"camera", "GUID|N", "the camera's GUID, or its number by order of the GUIDs (default: 0)", OPTION_TEXT,
         &words.camera, 0, 0},
        {"skip", "N", "take one of N frames (default: 1, each)", OPTION_NUMBER, &grabber.skip, 1, 100000},
        {"size", "SIZE", SIZE_NAMES, OPTION_TEXT, &words.size, 0, 0},
        {"name", "ITEM", "the video item to write (default: video)", OPTION_NAME, &grabber.name, 0,
         DDX_NAME_MAX - (long)sizeof ".parameters" + 1},
        {"layout", "LAYOUT", "pictures in " VIDEO_LAYOUT_NAMES " (default: YUV420P)", OPTION_TEXT, &words.layout, 0, 0},
        {"mode", "MODE", MODE_NAMES " (default: the nearest to -size, or as it is set)", OPTION_TEXT, &words.mode, 0,
         0},
        {"rate", "R", "frames per second to ask of the camera, such as 7.5 (default: the fastest)", OPTION_TEXT,
         &words.rate, 0, 0},
        {"format", "CODING", "of FORMAT7: " CODING_NAMES, OPTION_TEXT, &words.format, 0, 0},
        {"roi", "X,Y,W,H", "of FORMAT7: this part of the picture (default: all of it)", OPTION_TEXT, &words.roi, 0, 0},
        {"bayer", "PATTERN", "how a raw picture begins: " BAYER_NAMES " (default: as the camera says)", OPTION_TEXT,
         &words.bayer, 0, 0},
        {"list", NULL, "print the cameras, their modes and rates", OPTION_FLAG, &list, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    iidc_camera_init(&iidc);
    grabber.program = (struct program){
        .name = "ddxvideo1394",
        .purpose = "Grabs from an IIDC camera, on FireWire or USB, into the store, as a video item; the frame numbers\n"
                   "go into item `<name>.frame`. Waits for a camera that is not there, busy or silent, and for one\n"
                   "that went away.",
        .notes = "Pictures of another size than -size are scaled. Counters, of the frames that -skip leaves:\n"
                 "lost.driver = missing by the camera's numbers or the frames' times, lost.error = damaged,\n"
                 "lost.away = while the camera was away (counted by the clock), lost.store = could not be written\n"
                 "into the store.",
        .options = options,
    };
    program_start(&grabber.program, argc, argv);
    understand(&iidc, &words);
    if (grabber.program.check)
        return EXIT_OK;
    if (list)
        return bus_list();
    av_log_set_level(AV_LOG_FATAL); /* its warnings would come with every frame */
    return grabber_run(&grabber);
}
