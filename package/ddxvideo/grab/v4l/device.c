/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "device.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/ioctl.h>

#include "fraction.h"
#include "geometry.h"

int device_ioctl(int fd, unsigned long request, void *argument) {
    int result;

    do
        result = ioctl(fd, request, argument);
    while (result < 0 && errno == EINTR);
    return result < 0 ? -errno : 0;
}

/* ---- The socket of a frame grabber, and the television standard ---- */

static const struct {
    const char *name;
    v4l2_std_id standard;
} standards[] = {{"PAL", V4L2_STD_PAL}, {"NTSC", V4L2_STD_NTSC}, {"SECAM", V4L2_STD_SECAM}};

bool input_parse_standard(const char *text, v4l2_std_id *standard) {
    for (unsigned i = 0; i < sizeof standards / sizeof *standards; i++) {
        if (!strcasecmp(text, standards[i].name)) {
            *standard = standards[i].standard;
            return true;
        }
    }
    return false;
}

bool input_is_meant(const struct v4l2_input *input, const char *text) {
    char *end;
    unsigned long number = strtoul(text, &end, 10);

    if (isdigit((unsigned char)*text) && !*end)
        return number == input->index;
    return !strncasecmp((const char *)input->name, text, strlen(text));
}

static int select_input(int fd, const char *text, char *why, size_t size) {
    struct v4l2_input input = {.index = 0};

    for (; !device_ioctl(fd, VIDIOC_ENUMINPUT, &input); input.index++) {
        if (!input_is_meant(&input, text))
            continue;
        int index = (int)input.index, error = device_ioctl(fd, VIDIOC_S_INPUT, &index);
        if (error)
            snprintf(why, size, "input %s: %s", input.name, strerror(-error));
        return error;
    }
    char names[128] = "";
    for (input.index = 0; !device_ioctl(fd, VIDIOC_ENUMINPUT, &input); input.index++)
        snprintf(names + strlen(names), sizeof names - strlen(names), "%s%s", input.index ? ", " : "", input.name);
    snprintf(why, size, "no input %s; there are: %s", text, *names ? names : "none");
    return -EINVAL;
}

static int select_standard(int fd, v4l2_std_id standard, char *why, size_t size) {
    int error = device_ioctl(fd, VIDIOC_S_STD, &standard);

    if (error == -ENOTTY || error == -ENODATA) {
        snprintf(why, size, "this input has no television standard");
        return -EINVAL;
    }
    if (error)
        snprintf(why, size, "television standard: %s", strerror(-error));
    return error;
}

int input_select(int fd, const char *input, const char *standard, char *why, size_t size) {
    v4l2_std_id wanted, found, present;
    int error = input ? select_input(fd, input, why, size) : 0;
    if (error)
        return error;
    if (standard)
        return input_parse_standard(standard, &wanted) ? select_standard(fd, wanted, why, size) : -EINVAL;
    struct v4l2_dv_timings timings = {.type = 0};
    if (!device_ioctl(fd, VIDIOC_QUERY_DV_TIMINGS, &timings))
        device_ioctl(fd, VIDIOC_S_DV_TIMINGS, &timings);
    /* The signal decides if its standard differs from the one that is set. */
    if (device_ioctl(fd, VIDIOC_G_STD, &present) || device_ioctl(fd, VIDIOC_QUERYSTD, &found))
        return 0;
    if (found && !(found & present))
        return select_standard(fd, found, why, size);
    return 0;
}

/* ---- Pixel format, size, rate, fields, range and pixel aspect ---- */

/* The best first: a copy, chroma taken apart, chroma averaged, decoded, made of RGB; grey has no colour. */
static const struct {
    uint32_t fourcc;
    enum pixels_coding coding;
} formats[] = {
    {V4L2_PIX_FMT_YUV420, PIXELS_YU12}, {V4L2_PIX_FMT_NV12, PIXELS_NV12},   {V4L2_PIX_FMT_YUYV, PIXELS_YUYV},
    {V4L2_PIX_FMT_UYVY, PIXELS_UYVY},   {V4L2_PIX_FMT_MJPEG, PIXELS_MJPEG}, {V4L2_PIX_FMT_JPEG, PIXELS_JPEG},
    {V4L2_PIX_FMT_RGB24, PIXELS_RGB24}, {V4L2_PIX_FMT_GREY, PIXELS_GREY},   {V4L2_PIX_FMT_Y16, PIXELS_Y16},
};

#define FORMATS (sizeof formats / sizeof *formats)
#define FLUENT 24 /* frames a second; a format that reaches them need not be faster */

static enum pixels_coding coding_of(uint32_t fourcc) {
    for (unsigned i = 0; i < FORMATS; i++)
        if (formats[i].fourcc == fourcc)
            return formats[i].coding;
    return PIXELS_NONE;
}

uint32_t negotiate_fourcc(const char *name) {
    const struct pixels_format *format = pixels_named(name);

    for (unsigned i = 0; format && i < FORMATS; i++)
        if (formats[i].coding == format->coding)
            return formats[i].fourcc;
    return 0;
}

/* Highest rate of a format at a size, frames per second; 0: not known. */
static double greatest_rate(int fd, const struct v4l2_pix_format *pix) {
    struct v4l2_frmivalenum entry = {.pixel_format = pix->pixelformat, .width = pix->width, .height = pix->height};
    double best = 0;

    for (; !device_ioctl(fd, VIDIOC_ENUM_FRAMEINTERVALS, &entry); entry.index++) {
        const struct v4l2_fract *step =
            entry.type == V4L2_FRMIVAL_TYPE_DISCRETE ? &entry.discrete : &entry.stepwise.min;
        double rate = step->numerator ? (double)step->denominator / step->numerator : 0;

        best = rate > best ? rate : best;
        if (entry.type != V4L2_FRMIVAL_TYPE_DISCRETE)
            break;
    }
    return best;
}

static bool has_format(int fd, uint32_t fourcc) {
    struct v4l2_fmtdesc entry = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};

    for (; !device_ioctl(fd, VIDIOC_ENUM_FMT, &entry); entry.index++)
        if (entry.pixelformat == fourcc)
            return true;
    return false;
}

/*
 * Merit of a format: the requested size counts more than fluent motion, and the layout's own samples count least,
 * except if 16 bits are wanted; the list is in order of preference.
 */
static int merit(int fd, const struct device_wish *wish, struct v4l2_format format, uint32_t fourcc) {
    format.fmt.pix.pixelformat = fourcc;
    if (!has_format(fd, fourcc) || device_ioctl(fd, VIDIOC_TRY_FMT, &format) || format.fmt.pix.pixelformat != fourcc)
        return -1;
    bool exact =
        !wish->width || ((int)format.fmt.pix.width == wish->width && (int)format.fmt.pix.height == wish->height);
    double rate = greatest_rate(fd, &format.fmt.pix), wanted = wish->rate ? (double)wish->rate : FLUENT;
    bool fluent = rate == 0 || rate + 0.1 >= wanted, paper = video_layout_is_420(wish->layout->format);
    bool same = !paper && pixels_find(coding_of(fourcc))->layout == wish->layout->format;
    return 8 * (same && wish->layout->bytes == 2) + 4 * exact + 2 * fluent + same;
}

static uint32_t best_format(int fd, const struct device_wish *wish, const struct v4l2_format *format) {
    int best = -1;
    uint32_t found = 0;

    for (unsigned i = 0; i < FORMATS; i++) {
        uint32_t fourcc = formats[i].fourcc;
        int now = wish->fourcc && wish->fourcc != fourcc ? -1 : merit(fd, wish, *format, fourcc);

        if (now > best) {
            best = now;
            found = fourcc;
        }
    }
    return found;
}

static int set_format(struct device *device, const struct device_wish *wish, struct v4l2_pix_format *pix, char *why,
                      size_t size) {
    struct v4l2_format format = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    int error = device_ioctl(device->fd, VIDIOC_G_FMT, &format);

    if (!error) {
        if (wish->width) {
            format.fmt.pix.width = (unsigned)wish->width;
            format.fmt.pix.height = (unsigned)wish->height;
        }
        format.fmt.pix.field = wish->fields ? V4L2_FIELD_INTERLACED : V4L2_FIELD_ANY;
        format.fmt.pix.bytesperline = format.fmt.pix.sizeimage = 0;
        format.fmt.pix.pixelformat = best_format(device->fd, wish, &format);
        if (!format.fmt.pix.pixelformat) {
            snprintf(why, size, "%s has no pixel format that is known here", device->card);
            return -EINVAL;
        }
        error = device_ioctl(device->fd, VIDIOC_S_FMT, &format);
    }
    if (error)
        snprintf(why, size, "%s", error == -EBUSY ? "in use by another program" : strerror(-error));
    *pix = format.fmt.pix;
    return error;
}

static bool take_order(struct device *device, uint32_t field, bool bottom_first) {
    static const struct {
        uint32_t field;
        enum pixels_order order;
        char letter;
    } table[] = {
        {V4L2_FIELD_NONE, PIXELS_PROGRESSIVE, 'p'},          {V4L2_FIELD_TOP, PIXELS_PROGRESSIVE, 'p'},
        {V4L2_FIELD_BOTTOM, PIXELS_PROGRESSIVE, 'p'},        {V4L2_FIELD_ALTERNATE, PIXELS_PROGRESSIVE, 'p'},
        {V4L2_FIELD_INTERLACED, PIXELS_INTERLEAVED, 't'},    {V4L2_FIELD_INTERLACED_TB, PIXELS_INTERLEAVED, 't'},
        {V4L2_FIELD_INTERLACED_BT, PIXELS_INTERLEAVED, 'b'}, {V4L2_FIELD_SEQ_TB, PIXELS_TOP_BOTTOM, 't'},
        {V4L2_FIELD_SEQ_BT, PIXELS_BOTTOM_TOP, 'b'},
    };

    for (unsigned i = 0; i < sizeof table / sizeof *table; i++) {
        if (table[i].field == field) {
            device->pixels.order = table[i].order;
            device->geometry.interlacing = field == V4L2_FIELD_INTERLACED && bottom_first ? 'b' : table[i].letter;
            return true;
        }
    }
    return false;
}

/* Pixel aspect, if the driver knows it: a frame grabber scales the picture to the requested size. */
static void take_aspect(struct device *device) {
    struct v4l2_cropcap crop = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    struct ddxvideo_geometry *geometry = &device->geometry;

    if (device_ioctl(device->fd, VIDIOC_CROPCAP, &crop) || !crop.pixelaspect.numerator ||
        !crop.pixelaspect.denominator || !crop.defrect.width || !crop.defrect.height)
        return;
    /* V4L2 has height over width here */
    geometry->aspect_num = (int)crop.pixelaspect.denominator;
    geometry->aspect_den = (int)crop.pixelaspect.numerator;
    geometry_scale_aspect(geometry, (int)crop.defrect.width, (int)crop.defrect.height);
}

static void take_rate(struct device *device, const struct device_wish *wish) {
    struct v4l2_streamparm parameters = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    struct v4l2_captureparm *capture = &parameters.parm.capture;

    if (wish->rate) {
        capture->timeperframe = (struct v4l2_fract){1, (uint32_t)wish->rate};
        device_ioctl(device->fd, VIDIOC_S_PARM, &parameters);
    }
    if (device_ioctl(device->fd, VIDIOC_G_PARM, &parameters) || !capture->timeperframe.numerator ||
        !capture->timeperframe.denominator)
        return;
    int num, den;
    fraction_set(&num, &den, capture->timeperframe.denominator, capture->timeperframe.numerator);
    if (!ddxvideo_rate_known(num, den))
        return;
    device->geometry.rate_num = num;
    device->geometry.rate_den = den;
}

static int range_of(const struct v4l2_pix_format *pix) {
    if (coding_of(pix->pixelformat) == PIXELS_RGB24)
        return DDX_VIDEO_RANGE_LIMITED; /* of the result */
    if (pixels_find(coding_of(pix->pixelformat))->compressed)
        return DDX_VIDEO_RANGE_FULL; /* the range of JPEG, whatever the driver reports */
    uint32_t quantization = pix->quantization;
    if (quantization == V4L2_QUANTIZATION_DEFAULT) /* of Y'CbCr, where only JPEG has the full range */
        quantization =
            pix->colorspace == V4L2_COLORSPACE_JPEG ? V4L2_QUANTIZATION_FULL_RANGE : V4L2_QUANTIZATION_LIM_RANGE;
    return quantization == V4L2_QUANTIZATION_FULL_RANGE ? DDX_VIDEO_RANGE_FULL : DDX_VIDEO_RANGE_LIMITED;
}

int negotiate(struct device *device, const struct device_wish *wish, char *why, size_t size) {
    struct v4l2_pix_format pix;
    v4l2_std_id standard = 0;
    int error = input_select(device->fd, wish->input, wish->standard, why, size);

    if (!error)
        error = set_format(device, wish, &pix, why, size);
    if (error)
        return error;
    device->pixels = (struct pixels){.coding = coding_of(pix.pixelformat),
                                     .width = (int)pix.width,
                                     .height = (int)pix.height,
                                     .stride = (int)pix.bytesperline,
                                     .depth = 16};
    device->geometry = (struct ddxvideo_geometry){
        .width = (int)pix.width, .height = (int)pix.height, .fields = 1, .range = range_of(&pix)};
    if (pixels_find(device->pixels.coding)->compressed)
        device->geometry.format = DDX_VIDEO_420_JPEG;
    device_ioctl(device->fd, VIDIOC_G_STD, &standard);
    if (!take_order(device, pix.field, (standard & V4L2_STD_525_60) != 0)) {
        snprintf(why, size, "%s gives fields in an order that is not known here", device->card);
        return -EINVAL;
    }
    if (wish->fields && device->pixels.order == PIXELS_PROGRESSIVE) {
        snprintf(why, size, "%s has no two fields in its pictures to be stacked", device->card);
        return -EINVAL;
    }
    take_rate(device, wish);
    take_aspect(device);
    return 0;
}
