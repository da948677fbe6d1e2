/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoV4L: grabs from a Video4Linux camera into the store. */
#include <errno.h>
#include <fcntl.h>
#include <libavutil/log.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "camera.h"
#include "controls.h"
#include "ddx_time.h"
#include "device.h"
#include "geometry.h"
#include "grabber.h"
#include "reorder.h"

/* A Video4Linux camera as the grabber uses it. */
struct v4l_camera {
    struct camera camera; /* first, since the grabber uses this part */
    struct device_wish wish;
    struct device device;
    struct order order;
    struct v4l2_buffer taken[DEVICE_BUFFERS]; /* of waiting frames */
};

/* ---- Open ---- */

#define LARGE_PICTURE (1 << 20) /* bytes; larger pictures get fewer buffers */
#define FEW_BUFFERS 5

/* Requests an event when another signal comes in. */
static void listen_to_source(int fd) {
    struct v4l2_event_subscription source = {.type = V4L2_EVENT_SOURCE_CHANGE};
    int input = 0;

    if (!device_ioctl(fd, VIDIOC_G_INPUT, &input))
        source.id = (unsigned)input;
    device_ioctl(fd, VIDIOC_SUBSCRIBE_EVENT, &source);
}

static int check_abilities(struct device *device, char *why, size_t size) {
    struct v4l2_capability able;
    int error = device_ioctl(device->fd, VIDIOC_QUERYCAP, &able);

    if (error == -ENOTTY || error == -EINVAL) {
        snprintf(why, size, "no video device");
        return -EINVAL;
    }
    if (error) {
        snprintf(why, size, "%s", strerror(-error));
        return error;
    }
    snprintf(device->card, sizeof device->card, "%.32s", (const char *)able.card);
    if (!(able.device_caps & V4L2_CAP_VIDEO_CAPTURE) || !(able.device_caps & V4L2_CAP_STREAMING)) {
        snprintf(why, size, "%s gives no pictures here; another device of it may", device->card);
        return -EINVAL;
    }
    return 0;
}

static int map_buffers(struct device *device) {
    for (unsigned i = 0; i < device->buffers; i++) {
        struct v4l2_buffer buffer = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = i};
        int error = device_ioctl(device->fd, VIDIOC_QUERYBUF, &buffer);

        if (error)
            return error;
        void *data = mmap(NULL, buffer.length, PROT_READ, MAP_SHARED, device->fd, (off_t)buffer.m.offset);
        if (data == MAP_FAILED)
            return -errno;
        device->buffer[i].data = data;
        device->buffer[i].size = buffer.length;
        error = device_ioctl(device->fd, VIDIOC_QBUF, &buffer);
        if (error)
            return error;
    }
    return 0;
}

static int start(struct device *device, char *why, size_t size) {
    bool large = device->geometry.width * device->geometry.height > LARGE_PICTURE;
    struct v4l2_requestbuffers request = {
        .count = large ? FEW_BUFFERS : DEVICE_BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    int error = device_ioctl(device->fd, VIDIOC_REQBUFS, &request);

    if (!error) {
        device->buffers = request.count < DEVICE_BUFFERS ? request.count : DEVICE_BUFFERS;
        error = map_buffers(device);
    }
    if (!error)
        error = device_ioctl(device->fd, VIDIOC_STREAMON, &type);
    if (error == -EBUSY)
        snprintf(why, size, "in use by another program");
    else if (error)
        snprintf(why, size, "does not start: %s", strerror(-error));
    device->streaming = !error;
    return error;
}

static void device_close(struct device *device) {
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;

    if (device->fd < 0)
        return;
    if (device->streaming)
        device_ioctl(device->fd, VIDIOC_STREAMOFF, &type);
    for (unsigned i = 0; i < device->buffers; i++)
        if (device->buffer[i].data)
            munmap(device->buffer[i].data, device->buffer[i].size);
    close(device->fd);
    memset(device, 0, sizeof *device);
    device->fd = -1;
}

/*
 * Open the camera, set it up and start the stream. 0, or -errno with the reason in one line at `why`; then it is
 * closed. -EINVAL: this camera cannot do what is requested.
 */
static int device_open(struct device *device, const struct device_wish *wish, char *why, size_t size) {
    memset(device, 0, sizeof *device);
    device->fd = open(wish->path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (device->fd < 0) {
        int error = -errno;
        bool missing = error == -ENOENT || error == -ENODEV || error == -ENXIO;

        snprintf(why, size, "%s",
                 missing           ? "not there"
                 : error == -EBUSY ? "in use by another program"
                                   : strerror(-error));
        return error;
    }
    int error = check_abilities(device, why, size);
    if (!error)
        error = negotiate(device, wish, why, size);
    if (!error)
        error = start(device, why, size);
    if (error)
        device_close(device);
    else
        listen_to_source(device->fd);
    return error;
}

/* ---- Frames of the driver ---- */

/* The next filled buffer; -EAGAIN: there is none yet; -ENODEV: unplugged; -EIO and others: the stream is broken. */
static int device_take(struct device *device, struct v4l2_buffer *buffer) {
    *buffer = (struct v4l2_buffer){.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    int error = device_ioctl(device->fd, VIDIOC_DQBUF, buffer);
    if (error)
        return error;
    if (buffer->index >= device->buffers)
        return -EIO;
    if (buffer->bytesused > device->buffer[buffer->index].size)
        buffer->bytesused = (uint32_t)device->buffer[buffer->index].size;
    return 0;
}

/* Give a buffer back to the driver. */
static int device_give(struct device *device, struct v4l2_buffer *buffer) {
    struct v4l2_buffer again = {
        .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = buffer->index};
    int error = device_ioctl(device->fd, VIDIOC_QBUF, &again);

    return error == -EINVAL ? device_ioctl(device->fd, VIDIOC_QBUF, &again) : error; /* may be temporary */
}

/* ---- Controls ---- */

/* Whether its value is a number that fits a parameter. */
static bool is_number(const struct v4l2_queryctrl *query) {
    switch (query->type) {
    case V4L2_CTRL_TYPE_INTEGER:
    case V4L2_CTRL_TYPE_BOOLEAN:
    case V4L2_CTRL_TYPE_MENU:
    case V4L2_CTRL_TYPE_INTEGER_MENU:
    case V4L2_CTRL_TYPE_BITMASK:
    case V4L2_CTRL_TYPE_BUTTON: return !(query->flags & V4L2_CTRL_FLAG_DISABLED);
    default: return false;
    }
}

/* Reads range, flags and value. */
static void describe(struct controls *controls, int i, int fd, const struct v4l2_queryctrl *query) {
    bool button = query->type == V4L2_CTRL_TYPE_BUTTON;
    struct v4l2_control now = {.id = query->id};

    controls->kind[i] = button ? CONTROL_BUTTON : query->type == V4L2_CTRL_TYPE_BITMASK ? CONTROL_BITS : CONTROL_NUMBER;
    controls->list.parameter[i].minimum = button ? 0 : query->minimum;
    controls->list.parameter[i].maximum = button ? 1 : query->maximum;
    controls->list.parameter[i].step = query->step > 0 ? query->step : 1;
    controls->list.parameter[i].initial = button ? 0 : query->default_value;
    controls->list.parameter[i].flags =
        (query->flags & (V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_GRABBED) ? DDX_VIDEO_PARAMETER_READ_ONLY : 0) |
        (query->flags & V4L2_CTRL_FLAG_INACTIVE ? DDX_VIDEO_PARAMETER_AUTOMATIC : 0);
    if (!button && !(query->flags & V4L2_CTRL_FLAG_WRITE_ONLY) && !device_ioctl(fd, VIDIOC_G_CTRL, &now))
        controls->list.parameter[i].value = now.value;
}

static void add(struct controls *controls, int fd, const struct v4l2_queryctrl *query) {
    struct v4l2_event_subscription follow = {.type = V4L2_EVENT_CTRL, .id = query->id};
    int i = is_number(query) ? controls_add(controls, query->id, (const char *)query->name) : -1;

    if (i < 0)
        return;
    describe(controls, i, fd, query);
    device_ioctl(fd, VIDIOC_SUBSCRIBE_EVENT, &follow);
}

/* Fill the empty list, and subscribe to the events of its controls. */
static void v4l_controls_list(struct controls *controls, int fd) {
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};

    for (; !device_ioctl(fd, VIDIOC_QUERYCTRL, &query); query.id |= V4L2_CTRL_FLAG_NEXT_CTRL)
        add(controls, fd, &query);
}

/* Read a control that has changed again. */
static void v4l_controls_follow(struct controls *controls, int fd, uint32_t id) {
    struct v4l2_queryctrl query = {.id = id};
    int i = controls_find(controls, id);

    if (i >= 0 && !device_ioctl(fd, VIDIOC_QUERYCTRL, &query))
        describe(controls, i, fd, &query);
}

/* 0, or -errno. */
static int v4l_controls_set(int fd, uint32_t id, int value) {
    struct v4l2_control control = {.id = id, .value = value};

    return device_ioctl(fd, VIDIOC_S_CTRL, &control);
}

/* ---- Camera ---- */

#define ORDER_NS (50 * MS) /* or half a period: longest wait of a frame for an earlier one */

static struct v4l_camera *v4l_of(struct camera *camera) {
    return (struct v4l_camera *)camera;
}

static int v4l_open(struct camera *camera, char *why, size_t size) {
    struct v4l_camera *v4l = v4l_of(camera);

    v4l->wish.width = camera->width;
    v4l->wish.height = camera->height;
    v4l->wish.fields = camera->fields;
    v4l->wish.layout = camera->layout;
    int error = device_open(&v4l->device, &v4l->wish, why, size);
    if (error)
        return error;
    camera->fd = v4l->device.fd;
    snprintf(camera->card, sizeof camera->card, "%s", v4l->device.card);
    camera->pixels = v4l->device.pixels;
    camera->geometry = v4l->device.geometry;
    order_restart(&v4l->order);
    return 0;
}

static void v4l_close(struct camera *camera) {
    device_close(&v4l_of(camera)->device);
    camera->fd = -1;
}

/* How long a frame waits for an earlier one. */
static int64_t patience_for_order(const struct camera *camera) {
    return camera->period > 0 && camera->period < 2 * ORDER_NS ? camera->period / 2 : ORDER_NS;
}

static int64_t v4l_due(const struct camera *camera) {
    return order_due(&((const struct v4l_camera *)camera)->order, patience_for_order(camera));
}

/* The capture time, if the driver has it by CLOCK_MONOTONIC. */
static int64_t time_of(const struct v4l2_buffer *buffer) {
    bool monotonic = (buffer->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;

    return monotonic ? buffer->timestamp.tv_sec * SECOND + buffer->timestamp.tv_usec * 1000 : 0;
}

static bool next_in_order(struct v4l_camera *v4l, int64_t now, struct camera_frame *frame) {
    unsigned slot;

    if (!order_next(&v4l->order, now, patience_for_order(&v4l->camera), &slot))
        return false;
    const struct v4l2_buffer *buffer = &v4l->taken[slot];
    *frame = (struct camera_frame){.data = v4l->device.buffer[slot].data,
                                   .size = buffer->bytesused,
                                   .time = time_of(buffer),
                                   .damaged = (buffer->flags & V4L2_BUF_FLAG_ERROR) != 0,
                                   .sequence = buffer->sequence,
                                   .slot = slot};
    return true;
}

static int v4l_take(struct camera *camera, int64_t now, struct camera_frame *frame) {
    struct v4l_camera *v4l = v4l_of(camera);
    struct v4l2_buffer buffer;
    int error = 0;

    while (!error && !next_in_order(v4l, now, frame)) {
        error = now < INT64_MAX ? device_take(&v4l->device, &buffer) : -EAGAIN;
        if (error)
            break;
        v4l->taken[buffer.index] = buffer;
        if (!order_add(&v4l->order, buffer.sequence, buffer.index, now))
            error = device_give(&v4l->device, &buffer);
    }
    return error;
}

static int v4l_give(struct camera *camera, const struct camera_frame *frame) {
    struct v4l_camera *v4l = v4l_of(camera);

    return device_give(&v4l->device, &v4l->taken[frame->slot]);
}

static enum camera_event v4l_events(struct camera *camera, struct controls *controls) {
    enum camera_event found = CAMERA_NOTHING;
    struct v4l2_event event;

    while (!device_ioctl(camera->fd, VIDIOC_DQEVENT, &event)) {
        if (event.type == V4L2_EVENT_SOURCE_CHANGE)
            return CAMERA_OTHER_SIGNAL;
        v4l_controls_follow(controls, camera->fd, event.id);
        found = CAMERA_CONTROLS_CHANGED;
    }
    return found;
}

static void v4l_list(struct camera *camera, struct controls *controls) {
    v4l_controls_list(controls, camera->fd);
}

static void v4l_refresh(struct camera *camera, struct controls *controls) {
    for (int i = 0; i < controls->list.count; i++)
        v4l_controls_follow(controls, camera->fd, controls->id[i]);
}

static int v4l_set(struct camera *camera, uint32_t id, int value) {
    return v4l_controls_set(camera->fd, id, value);
}

/* Start as closed; the caller then fills in `wish`. */
static void v4l_camera_init(struct v4l_camera *v4l) {
    static const struct camera_functions functions = {.open = v4l_open,
                                                      .close = v4l_close,
                                                      .take = v4l_take,
                                                      .give = v4l_give,
                                                      .due = v4l_due,
                                                      .events = v4l_events,
                                                      .list = v4l_list,
                                                      .refresh = v4l_refresh,
                                                      .set = v4l_set};

    *v4l = (struct v4l_camera){.camera = {.call = &functions, .name = v4l->wish.path, .fd = -1}, .device = {.fd = -1}};
}

/* ---- Program ---- */

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
        {"standard", "NAME", "PAL, NTSC or SECAM (default: what is on the line)", OPTION_TEXT, &v4l.wish.standard, 0,
         0},
        {"deinterlace", "stack", "two fields (a line-interlaced stereo pair) one above the other", OPTION_TEXT,
         &words.deinterlace, 0, 0},
        {"format", "NAME", "the camera's pixels: YU12, NV12, YUYV, UYVY, MJPEG, RGB24, GREY or Y16 (default: the best)",
         OPTION_TEXT, &words.format, 0, 0},
        {"layout", "LAYOUT", "pictures in " VIDEO_LAYOUT_NAMES " (default: YUV420P)", OPTION_TEXT, &words.layout, 0, 0},
        {"rate", "R", "frames per second to ask of the camera (default: as it is set)", OPTION_NUMBER, &v4l.wish.rate,
         1, 1000},
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
