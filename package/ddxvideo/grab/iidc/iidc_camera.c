/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "iidc_camera.h"

#include <arpa/inet.h>
#include <errno.h>
#include <glob.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "ddx_time.h"
#include "iidc_controls.h"
#include "library_log.h"
#include "setup.h"
#include "program.h"

/* ---- The counter in the first pixels ---- */

/* Point Grey's cameras write it into each frame. */

#define POINT_GREY 0xb09d
#define FRAME_INFO 0x12f8
#define PRESENT UINT32_C(0x80000000)
#define FRAME_COUNTER UINT32_C(0x40)

/* Switch it on (`wanted`) or off. Returns whether the frames have it now. */
static bool counter_switch(dc1394camera_t *device, bool wanted) {
    uint32_t value = 0;

    if (device->vendor_id != POINT_GREY || dc1394_get_control_register(device, FRAME_INFO, &value) ||
        !(value & PRESENT))
        return false;
    uint32_t parts = PRESENT | (wanted ? FRAME_COUNTER : 0);
    return !dc1394_set_control_register(device, FRAME_INFO, parts) &&
           !dc1394_get_control_register(device, FRAME_INFO, &value) && value & FRAME_COUNTER;
}

/* Read it from a frame, and replace it by the pixels two rows below, which have the same colours. */
static uint32_t counter_take(dc1394video_frame_t *frame) {
    size_t below = 2 * (size_t)frame->stride;
    uint32_t number;

    if (frame->image_bytes < sizeof number) /* a picture of one or two pixels */
        return 0;
    memcpy(&number, frame->image, sizeof number);
    if (frame->size[1] > 2 && frame->image_bytes >= below + sizeof number)
        memcpy(frame->image, frame->image + below, sizeof number);
    return ntohl(number);
}

/* ---- Buses ---- */

#define GUID_DIGITS 16
#define NUMBER_DIGITS 3

bool bus_parse(const char *text, struct bus_wish *wish) {
    if (!strncmp(text, "0x", 2))
        text += 2;
    size_t digits = strspn(text, "0123456789abcdefABCDEF");
    if (digits == GUID_DIGITS && !text[digits]) {
        wish->guid = strtoull(text, NULL, 16);
        return wish->guid != 0;
    }
    digits = strspn(text, "0123456789");
    wish->number = (unsigned)strtoul(text, NULL, 10);
    return digits > 0 && digits <= NUMBER_DIGITS && !text[digits];
}

static int compare(const void *a, const void *b) {
    uint64_t first = ((const dc1394camera_id_t *)a)->guid, second = ((const dc1394camera_id_t *)b)->guid;

    return first < second ? -1 : first > second;
}

/* All cameras, ordered by GUID; NULL: the search failed. `silent`: a plugged camera is not among them. */
static dc1394camera_list_t *find_all(dc1394_t *library, bool *silent) {
    dc1394camera_list_t *list = NULL;

    library_log_mute(true);
    dc1394error_t error = dc1394_camera_enumerate(library, &list);
    *silent = library_log_mute(false) > 0;
    if (error)
        return NULL;
    if (list->num)
        qsort(list->ids, list->num, sizeof *list->ids, compare);
    return list;
}

static bool choose(const dc1394camera_list_t *list, struct bus_wish *wish) {
    for (unsigned i = 0; i < list->num; i++) {
        if (wish->guid ? list->ids[i].guid == wish->guid : i == wish->number) {
            wish->guid = list->ids[i].guid;
            return true;
        }
    }
    return false;
}

static void bus_close(dc1394_t *library, dc1394camera_t *device) {
    if (device)
        dc1394_camera_free(device);
    if (library)
        dc1394_free(library);
}

/*
 * Look for the camera and open it. 0; -ENODEV: it is not there; -EBUSY: it is there, or may be; with the reason in one
 * line at `why`. After success the wish has the GUID, so that the same camera is found after it was unplugged.
 */
static int bus_open(struct bus_wish *wish, dc1394_t **library, dc1394camera_t **device, char *why, size_t size) {
    *device = NULL;
    *library = dc1394_new(); /* opened for each search: it knows only the buses of that moment */
    bool silent = false;
    dc1394camera_list_t *list = *library ? find_all(*library, &silent) : NULL;
    bool there = list && choose(list, wish);

    if (list)
        dc1394_camera_free_list(list);
    if (there)
        *device = dc1394_camera_new(*library, wish->guid);
    if (*device)
        return 0;
    bus_close(*library, NULL);
    *library = NULL;
    snprintf(why, size, "%s",
             there    ? "in use by another program, or does not answer"
             : silent ? "not found, but a camera that is plugged in does not answer: plug it in again"
                      : "not there");
    return there || silent ? -EBUSY : -ENODEV;
}

/* FNV-1a */
static uint64_t add(uint64_t sum, uint64_t value) {
    for (int i = 0; i < 64; i += 8)
        sum = (sum ^ (value >> i & 0xff)) * UINT64_C(1099511628211);
    return sum;
}

/* `rights`: also their owners, and the times of the last change. */
static uint64_t look_at_devices(bool rights) {
    uint64_t sum = UINT64_C(14695981039346656037);
    glob_t found;

    if (!glob("/dev/fw[0-9]*", 0, NULL, &found))
        glob("/dev/bus/usb/*/*", GLOB_APPEND, NULL, &found);
    else if (glob("/dev/bus/usb/*/*", 0, NULL, &found))
        return sum;
    for (size_t i = 0; i < found.gl_pathc; i++) {
        struct stat status;

        if (stat(found.gl_pathv[i], &status))
            continue;
        sum = add(sum, status.st_ino);
        if (!rights)
            continue;
        sum = add(add(sum, status.st_uid), status.st_mode);
        sum = add(add(sum, (uint64_t)status.st_ctim.tv_sec), (uint64_t)status.st_ctim.tv_nsec);
    }
    globfree(&found);
    return sum;
}

/* Changes when a device comes or goes, or gets another owner. */
static uint64_t bus_devices(void) {
    return look_at_devices(true);
}

/* Changes when a device comes or goes, but not when mdev sets its rights. */
static uint64_t bus_files(void) {
    return look_at_devices(false);
}

static void print_format7(dc1394camera_t *device, dc1394video_mode_t mode) {
    dc1394color_codings_t codings = {.num = 0};
    uint32_t width = 0, height = 0, unit_x = 0, unit_y = 0;

    dc1394_format7_get_max_image_size(device, mode, &width, &height);
    dc1394_format7_get_unit_size(device, mode, &unit_x, &unit_y);
    dc1394_format7_get_color_codings(device, mode, &codings);
    printf("  %s up to %ux%u in steps of %ux%u:", mode_name(mode), width, height, unit_x, unit_y);
    for (unsigned i = 0; i < codings.num && i < DC1394_COLOR_CODING_NUM; i++)
        if (mode_coding_name(codings.codings[i]))
            printf(" %s", mode_coding_name(codings.codings[i]));
    printf("\n");
}

static void print_fixed(dc1394camera_t *device, dc1394video_mode_t mode) {
    dc1394framerates_t rates = {.num = 0};
    int num, den;

    dc1394_video_get_supported_framerates(device, mode, &rates);
    printf("  %s:", mode_name(mode));
    for (unsigned i = 0; i < rates.num && i < DC1394_FRAMERATE_NUM; i++) {
        mode_rate(rates.framerates[i], &num, &den);
        printf(" %g", (double)num / den);
    }
    printf(" fps\n");
}

static void print_camera(dc1394_t *library, unsigned number, uint64_t guid) {
    dc1394camera_t *device = dc1394_camera_new(library, guid);
    dc1394video_modes_t modes = {.num = 0};

    printf("%u: %016" PRIx64 " %s %s\n", number, guid, device && device->vendor ? device->vendor : "",
           !device         ? "in use"
           : device->model ? device->model
                           : "");
    if (!device)
        return;
    dc1394_video_get_supported_modes(device, &modes);
    for (unsigned i = 0; i < modes.num && i < DC1394_VIDEO_MODE_NUM; i++) {
        if (dc1394_is_video_mode_scalable(modes.modes[i]))
            print_format7(device, modes.modes[i]);
        else if (modes.modes[i] != DC1394_VIDEO_MODE_EXIF)
            print_fixed(device, modes.modes[i]);
    }
    dc1394_camera_free(device);
}

int bus_list(void) {
    dc1394_t *library = dc1394_new();
    bool silent = false;
    dc1394camera_list_t *list = library ? find_all(library, &silent) : NULL;
    unsigned count = list ? list->num : 0;

    for (unsigned i = 0; i < count; i++)
        print_camera(library, i, list->ids[i].guid);
    if (list)
        dc1394_camera_free_list(list);
    bus_close(library, NULL);
    if (silent)
        say("a camera that is plugged in does not answer, or this user may not open it");
    else if (!count)
        say("found no IIDC camera on FireWire or USB that this user may open");
    return count ? EXIT_OK : EXIT_FAILED;
}

/* ---- Camera ---- */

#define AGAIN_NS (3 * SECOND)       /* between attempts while the buses do not change */
#define ANSWER_NS (SECOND * 9 / 10) /* libdc1394 waits one second for an answer */
#define BUFFER_MEMORY (6 << 20)     /* of the kernel's 16 MiB for all USB devices */
#define FEW_BUFFERS 3

static struct iidc_camera *iidc_of(struct camera *camera) {
    return (struct iidc_camera *)camera;
}

static void iidc_close(struct camera *camera) {
    struct iidc_camera *iidc = iidc_of(camera);

    library_log_mute(iidc->gone);
    if (iidc->capturing) {
        dc1394_video_set_transmission(iidc->device, DC1394_OFF);
        dc1394_capture_stop(iidc->device);
    }
    bus_close(iidc->library, iidc->device);
    library_log_mute(false);
    iidc->library = NULL;
    iidc->device = NULL;
    iidc->capturing = false;
    camera->fd = -1;
}

static uint32_t buffers_for(const struct pixels *pixels) {
    int bytes = pixels->stride * pixels->height, buffers = BUFFER_MEMORY / bytes;

    return (uint32_t)(buffers < FEW_BUFFERS ? FEW_BUFFERS : buffers > IIDC_BUFFERS ? IIDC_BUFFERS : buffers);
}

static int start(struct iidc_camera *iidc, char *why, size_t size) {
    dc1394error_t error =
        dc1394_capture_setup(iidc->device, buffers_for(&iidc->camera.pixels), DC1394_CAPTURE_FLAGS_DEFAULT);

    iidc->capturing = !error;
    if (!error)
        error = dc1394_video_set_transmission(iidc->device, DC1394_ON);
    if (!error)
        return 0;
    snprintf(why, size, "does not start: %s",
             error == DC1394_NO_BANDWIDTH ? "no bandwidth is left on its bus; a lower -rate takes less"
                                          : dc1394_error_get_string(error));
    return -EIO;
}

/* Starts to number the frames by their times, unless an external trigger starts them. */
static void keep_pace(struct iidc_camera *iidc, int64_t period) {
    dc1394bool_t there = DC1394_FALSE;
    dc1394switch_t on = DC1394_OFF;

    if (!dc1394_feature_is_present(iidc->device, DC1394_FEATURE_TRIGGER, &there) && there)
        dc1394_external_trigger_get_power(iidc->device, &on);
    iidc->camera.triggered = on == DC1394_ON;
    pace_restart(&iidc->pace, iidc->camera.triggered ? PACE_NONE : period);
}

static void take_over(struct iidc_camera *iidc, const struct setup *setup) {
    struct camera *camera = &iidc->camera;
    const char *vendor = iidc->device->vendor, *model = iidc->device->model;
    const struct ddxvideo_geometry *given = &setup->geometry;

    camera->pixels = setup->pixels;
    camera->geometry = setup->geometry;
    snprintf(camera->card, sizeof camera->card, "%s%s%s", vendor ? vendor : "", vendor && model ? " " : "",
             model ? model : "");
    iidc->counts = counter_switch(iidc->device, setup->eight_bits);
    keep_pace(iidc, given->rate_num ? SECOND * given->rate_den / given->rate_num : 0);
}

static int open_now(struct iidc_camera *iidc, char *why, size_t size) {
    struct setup setup;

    iidc->gone = false;
    int error = bus_open(&iidc->bus, &iidc->library, &iidc->device, why, size);
    if (error)
        return error;
    snprintf(iidc->name, sizeof iidc->name, "camera %016" PRIx64, iidc->bus.guid);
    error = setup_camera(iidc->device, &iidc->wish, &setup, why, size);
    if (!error) {
        take_over(iidc, &setup);
        error = start(iidc, why, size);
    }
    if (error) {
        iidc_close(&iidc->camera);
        return error;
    }
    iidc->camera.fd = dc1394_capture_get_fileno(iidc->device);
    library_log_forget();
    return 0;
}

/*
 * The grabber tries often, but each attempt with a camera that does not answer takes a second and disturbs the other
 * cameras on the buses. So while no device comes or goes, the last reason is repeated for some seconds.
 */
static int iidc_open(struct camera *camera, char *why, size_t size) {
    struct iidc_camera *iidc = iidc_of(camera);
    uint64_t devices = bus_devices();

    if (!iidc->error || devices != iidc->devices || ddx_time_now() > iidc->tried + AGAIN_NS) {
        *iidc->why = 0;
        iidc->error = open_now(iidc, iidc->why, sizeof iidc->why);
        iidc->devices = devices;
        iidc->files = bus_files();
        iidc->tried = ddx_time_now();
    }
    if (iidc->error)
        snprintf(why, size, "%s", iidc->why);
    return iidc->error;
}

/*
 * Interprets a failure: a camera that is unplugged or no longer answers is gone; any other camera has lost its stream.
 * Access to an unplugged camera fails at once.
 */
static int fate(struct iidc_camera *iidc) {
    dc1394switch_t on;
    int64_t begin = ddx_time_now();

    library_log_mute(true);
    if (!iidc->gone && dc1394_video_get_transmission(iidc->device, &on)) {
        iidc->gone = true;
        iidc->unplugged = ddx_time_now() < begin + ANSWER_NS || bus_files() != iidc->files;
    }
    library_log_mute(false);
    return iidc->gone && iidc->unplugged ? -ENODEV : -EIO;
}

/* The frame's number: by the camera's counter, or by the frame's time. */
static uint32_t number_of(struct iidc_camera *iidc, dc1394video_frame_t *frame, bool damaged, int64_t time) {
    if (iidc->counts && !damaged)
        return iidc->pace.number = counter_take(frame);
    if (iidc->counts)
        return ++iidc->pace.number;
    if (frame->bus_cycle)
        return pace_bus_number(&iidc->pace, frame->bus_cycle, time);
    return pace_number(&iidc->pace, time, frame->frames_behind > 0);
}

static int iidc_take(struct camera *camera, int64_t now, struct camera_frame *frame) {
    struct iidc_camera *iidc = iidc_of(camera);
    dc1394video_frame_t *got = NULL;

    if (now == INT64_MAX)
        return -EAGAIN;
    if (dc1394_capture_dequeue(iidc->device, DC1394_CAPTURE_POLICY_POLL, &got))
        return fate(iidc);
    if (!got)
        return -EAGAIN;
    iidc->gone = false; /* it has missed only one access */
    bool damaged = dc1394_capture_is_frame_corrupt(iidc->device, got) || got->total_bytes < got->image_bytes;
    int64_t time = wall_time(&iidc->wall, got->timestamp, now, ddxvideo_wall_offset());
    *frame = (struct camera_frame){.data = got->image,
                                   .size = got->image_bytes,
                                   .time = time,
                                   .damaged = damaged,
                                   .sequence = number_of(iidc, got, damaged, time ? time : now),
                                   .slot = got->id % IIDC_BUFFERS};
    iidc->taken[frame->slot] = got;
    return 0;
}

static int iidc_give(struct camera *camera, const struct camera_frame *frame) {
    struct iidc_camera *iidc = iidc_of(camera);

    return dc1394_capture_enqueue(iidc->device, iidc->taken[frame->slot]) ? fate(iidc) : 0;
}

static int64_t iidc_due(const struct camera *camera) {
    (void)camera;
    return INT64_MAX;
}

static void iidc_list(struct camera *camera, struct controls *controls) {
    features_list(iidc_of(camera)->device, controls);
}

static void iidc_refresh(struct camera *camera, struct controls *controls) {
    features_refresh(iidc_of(camera)->device, controls);
}

static int iidc_set(struct camera *camera, uint32_t id, int value) {
    struct iidc_camera *iidc = iidc_of(camera);

    if (iidc->gone)
        return -ENODEV;
    int error = features_set(iidc->device, id, value);
    if (error == -EIO && fate(iidc) == -ENODEV)
        return -ENODEV;
    if (!error && features_changes_rate(id))
        keep_pace(iidc, 0);
    return error;
}

void iidc_camera_init(struct iidc_camera *iidc) {
    static const struct camera_functions functions = {.open = iidc_open,
                                                      .close = iidc_close,
                                                      .take = iidc_take,
                                                      .give = iidc_give,
                                                      .due = iidc_due,
                                                      .list = iidc_list,
                                                      .refresh = iidc_refresh,
                                                      .set = iidc_set};

    *iidc = (struct iidc_camera){.camera = {.call = &functions, .name = iidc->name, .fd = -1}};
    library_log_begin();
}
