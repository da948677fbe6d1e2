/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "bus.h"

#include <errno.h>
#include <glob.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "library_log.h"
#include "modes.h"
#include "program.h"

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

int bus_open(struct bus_wish *wish, dc1394_t **library, dc1394camera_t **device, char *why, size_t size) {
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

void bus_close(dc1394_t *library, dc1394camera_t *device) {
    if (device)
        dc1394_camera_free(device);
    if (library)
        dc1394_free(library);
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

uint64_t bus_devices(void) {
    return look_at_devices(true);
}

uint64_t bus_files(void) {
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
           !device ? "in use" : device->model ? device->model : "");
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
