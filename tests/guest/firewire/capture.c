/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Runs in a guest with the module of this folder: finds the cameras and captures from one of them, through libdc1394.
 *
 *   firewire list
 *   firewire capture CAMERA FPS FRAMES
 *   firewire repeat CAMERA TIMES
 *
 * Prints a line for each frame: its number (from its pixels), its bus cycle since the first one, the number of wrong
 * bytes, and whether the library calls it damaged. The last line is the bus's generation before and after. There are as
 * many buffers as frames, so that a slow machine loses none. "repeat" starts and stops a capture TIMES times. A failure
 * is one line and exit status 1.
 */
#include <dc1394/dc1394.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CYCLES 8000 /* a second; bus times wrap after eight seconds */
#define CHECK(call) check(call, #call)

static void check(dc1394error_t error, const char *what) {
    if (error == DC1394_SUCCESS)
        return;
    fprintf(stderr, "firewire: %s: %s\n", what, dc1394_error_get_string(error));
    exit(1);
}

static dc1394camera_t *find(dc1394_t *library, unsigned number) {
    dc1394camera_list_t *list;
    CHECK(dc1394_camera_enumerate(library, &list));
    dc1394camera_t *camera = NULL;
    for (unsigned i = 0; i < list->num; i++)
        if ((list->ids[i].guid & 15) == number)
            camera = dc1394_camera_new(library, list->ids[i].guid);
    dc1394_camera_free_list(list);
    if (!camera) {
        fprintf(stderr, "firewire: no camera %u\n", number);
        exit(1);
    }
    return camera;
}

static int list(dc1394_t *library) {
    dc1394camera_list_t *list;
    CHECK(dc1394_camera_enumerate(library, &list));
    for (unsigned i = 0; i < list->num; i++) {
        dc1394camera_t *camera = dc1394_camera_new(library, list->ids[i].guid);
        if (camera)
            printf("%016" PRIx64 " %s %s\n", camera->guid, camera->vendor, camera->model);
        dc1394_camera_free(camera);
    }
    dc1394_camera_free_list(list);
    return 0;
}

static uint32_t number_of(const unsigned char *image) {
    return (uint32_t)image[0] << 24 | (uint32_t)image[1] << 16 | (uint32_t)image[2] << 8 | image[3];
}

static unsigned wrong_bytes(const dc1394video_frame_t *frame, unsigned camera) {
    uint32_t number = number_of(frame->image);
    unsigned wrong = 0;
    for (uint32_t i = 4; i < frame->image_bytes; i++)
        wrong += frame->image[i] != (unsigned char)(number * 7 + camera * 31 + i + (i >> 8));
    return wrong;
}

static void set_up(dc1394camera_t *camera, const char *rate, unsigned frames) {
    dc1394framerate_t framerate = DC1394_FRAMERATE_30;
    if (!strcmp(rate, "15"))
        framerate = DC1394_FRAMERATE_15;
    if (!strcmp(rate, "7.5"))
        framerate = DC1394_FRAMERATE_7_5;
    CHECK(dc1394_video_set_iso_speed(camera, DC1394_ISO_SPEED_400));
    CHECK(dc1394_video_set_mode(camera, DC1394_VIDEO_MODE_640x480_MONO8));
    CHECK(dc1394_video_set_framerate(camera, framerate));
    CHECK(dc1394_capture_setup(camera, frames, DC1394_CAPTURE_FLAGS_DEFAULT));
    CHECK(dc1394_video_set_transmission(camera, DC1394_ON));
}

static void capture(dc1394camera_t *camera, unsigned which, unsigned frames) {
    unsigned last = 0, passed = 0;
    for (unsigned i = 0; i < frames; i++) {
        dc1394video_frame_t *frame;
        CHECK(dc1394_capture_dequeue(camera, DC1394_CAPTURE_POLICY_WAIT, &frame));
        if (i > 0)
            passed += (frame->bus_cycle + 8 * CYCLES - last) % (8 * CYCLES);
        last = frame->bus_cycle;
        printf("%" PRIu32 " %u %u %d\n", number_of(frame->image), passed, wrong_bytes(frame, which),
               dc1394_capture_is_frame_corrupt(camera, frame));
    }
}

/* A register, written and read. After a bus reset libdc1394 tries a request 20 times within half a millisecond, which
 * can be shorter than firewire-core takes to report the new generation. */
static void try_feature(dc1394camera_t *camera) {
    uint32_t value = 0;
    for (int i = 0; i < 100 && dc1394_feature_set_value(camera, DC1394_FEATURE_BRIGHTNESS, 77); i++)
        usleep(100000);
    CHECK(dc1394_feature_get_value(camera, DC1394_FEATURE_BRIGHTNESS, &value));
    if (value != 77) {
        fprintf(stderr, "firewire: brightness is %" PRIu32 "\n", value);
        exit(1);
    }
}

static uint32_t generation(dc1394camera_t *camera) {
    uint32_t node, number;
    CHECK(dc1394_camera_get_node(camera, &node, &number));
    return number;
}

static void try_camera(dc1394_t *library, unsigned which, const char *rate, unsigned frames) {
    dc1394camera_t *camera = find(library, which);
    set_up(camera, rate, frames);
    uint32_t before = generation(camera);
    capture(camera, which, frames);
    try_feature(camera);
    printf("%" PRIu32 " %" PRIu32 "\n", before, generation(camera));
    CHECK(dc1394_video_set_transmission(camera, DC1394_OFF));
    CHECK(dc1394_capture_stop(camera));
    dc1394_camera_free(camera);
}

/* Each capture allocates a channel and bandwidth, and must release them. */
static void repeat(dc1394_t *library, unsigned which, unsigned times) {
    dc1394camera_t *camera = find(library, which);
    for (unsigned i = 0; i < times; i++) {
        set_up(camera, "30", 4);
        CHECK(dc1394_video_set_transmission(camera, DC1394_OFF));
        CHECK(dc1394_capture_stop(camera));
    }
    dc1394_camera_free(camera);
}

int main(int argc, char **argv) {
    dc1394_t *library = dc1394_new();
    if (!library) {
        fprintf(stderr, "firewire: no bus\n");
        return 1;
    }
    if (argc == 2 && !strcmp(argv[1], "list"))
        return list(library);
    if (argc == 4 && !strcmp(argv[1], "repeat")) {
        repeat(library, (unsigned)atoi(argv[2]), (unsigned)atoi(argv[3]));
    } else if (argc == 5 && !strcmp(argv[1], "capture")) {
        try_camera(library, (unsigned)atoi(argv[2]), argv[3], (unsigned)atoi(argv[4]));
    } else {
        fprintf(stderr, "usage: firewire list | capture CAMERA FPS FRAMES | repeat CAMERA TIMES\n");
        return 2;
    }
    dc1394_free(library);
    return 0;
}
