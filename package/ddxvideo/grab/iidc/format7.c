/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "format7.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "fraction.h"
#include "modes.h"

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

int format7_set(dc1394camera_t *device, dc1394video_mode_t mode, const struct setup_wish *wish, bool firewire,
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

int format7_bayer(dc1394camera_t *device, dc1394video_mode_t mode, dc1394color_filter_t *bayer) {
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
