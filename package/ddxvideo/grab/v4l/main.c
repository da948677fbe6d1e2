/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoV4L: grabs from a Video4Linux camera into the store. */
#include <libavutil/log.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "grabber.h"
#include "input.h"
#include "negotiate.h"
#include "geometry.h"
#include "v4l_camera.h"

/* The options as text. */
struct words {
    const char *camera, *size, *format, *deinterlace, *layout;
};

/* Exits after a line if they are wrong. */
static void understand(struct grabber *grabber, struct v4l_camera *v4l, const struct words *words) {
    struct device_wish *wish = &v4l->wish;
    struct camera *camera = &v4l->camera;
    v4l2_std_id standard;
    bool number = words->camera[strspn(words->camera, "0123456789")] == 0;
    int length = snprintf(wish->path, sizeof wish->path, "%s%s", number ? "/dev/video" : "", words->camera);

    if ((!number && *words->camera != '/') || (size_t)length >= sizeof wish->path)
        program_bad_usage("-camera %s: a number or a path such as /dev/video0 is needed", words->camera);
    if (words->size && !size_parse(words->size, &camera->width, &camera->height))
        program_bad_usage("-size %s: one of %s is needed", words->size, SIZE_NAMES);
    camera->layout = video_layout_named(words->layout);
    if (!camera->layout)
        program_bad_usage("-layout %s: " VIDEO_LAYOUT_NAMES " is needed", words->layout);
    if (words->format && !(wish->fourcc = negotiate_fourcc(words->format)))
        program_bad_usage("-format %s: unknown", words->format);
    if (wish->standard && !input_parse_standard(wish->standard, &standard))
        program_bad_usage("-standard %s: PAL, NTSC or SECAM is needed", wish->standard);
    if (words->deinterlace && strcmp(words->deinterlace, "stack") != 0)
        program_bad_usage("-deinterlace %s: only `stack` is known", words->deinterlace);
    grabber->stack = camera->fields = words->deinterlace != NULL;
}

int main(int argc, char **argv) {
    struct v4l_camera v4l;
    struct grabber grabber = {.name = "video", .skip = 1, .camera = &v4l.camera};
    struct words words = {.camera = "0", .layout = "YUV420P"};
    const struct option_entry options[] = {
        {"camera", "N", "the camera /dev/videoN, or a path (default: 0)", OPTION_TEXT, &words.camera, 0, 0},
        {"skip", "N", "take one of N frames (default: 1, each)", OPTION_NUMBER, &grabber.skip, 1, 100000},
        {"size", "SIZE", SIZE_NAMES, OPTION_TEXT, &words.size, 0, 0},
        {"name", "ITEM", "the video item to write (default: video)", OPTION_NAME, &grabber.name, 0,
         DDX_NAME_MAX - (long)sizeof ".parameters" + 1},
        {"input", "NAME", "socket of a frame grabber: number, or how its name begins: Composite, S-Video", OPTION_TEXT,
         &v4l.wish.input, 0, 0},
        {"standard", "NAME", "PAL, NTSC or SECAM (default: what is on the line)", OPTION_TEXT, &v4l.wish.standard,
         0, 0},
        {"deinterlace", "stack", "two fields (a line-interlaced stereo pair) one above the other", OPTION_TEXT,
         &words.deinterlace, 0, 0},
        {"format", "NAME", "the camera's pixels: YU12, NV12, YUYV, UYVY, MJPEG, RGB24, GREY or Y16 (default: the best)",
         OPTION_TEXT, &words.format, 0, 0},
        {"layout", "LAYOUT", "pictures in " VIDEO_LAYOUT_NAMES " (default: YUV420P)", OPTION_TEXT, &words.layout, 0, 0},
        {"rate", "R", "frames per second to ask of the camera (default: as it is set)", OPTION_NUMBER,
         &v4l.wish.rate, 1, 1000},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    v4l_camera_init(&v4l);
    grabber.program = (struct program){
        .name = "ddxvideoV4L",
        .purpose = "Grabs from a Video4Linux camera into the store, as a video item; the frame numbers go into item\n"
                   "`<name>.frame`. Waits for a camera that is not there, busy or silent, and for one that went away.",
        .notes = "A frame's time is the driver's, its number the camera's: what is lost or skipped leaves a gap.\n"
                 "Pictures of another size than -size are scaled. Counters, of the frames that -skip leaves:\n"
                 "lost.driver = gaps in the driver's numbers, lost.error = damaged, lost.away = while the camera was\n"
                 "away (counted by the clock), lost.store = could not be written into the store.",
        .options = options,
    };
    program_start(&grabber.program, argc, argv);
    understand(&grabber, &v4l, &words);
    if (grabber.program.check)
        return EXIT_OK;
    av_log_set_level(AV_LOG_FATAL); /* its warnings would come with every frame */
    return grabber_run(&grabber);
}
