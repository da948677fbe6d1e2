/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "surface.h"

#include <stdio.h>
#include <stdlib.h>

#ifdef WITH_DRM
#include <ddx.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include "ddx_time.h"
#include "keys.h"

/*
 * ---- One output of a graphics card, through the kernel's DRM: its mode, and two buffers that take turns ----
 *
 * Functions return NULL, or the reason of a failure as a static text, valid until the next call. After a failure of
 * kms_open() nothing is open.
 */

#define CARDS 8
#define PATIENCE_MS 1000 /* a card whose flip takes longer does not refresh at all */
#define DEPTH 24
#define BITS 32

struct kms_buffer {
    uint32_t handle, frame; /* DRM's ids; 0: none */
    uint32_t *pixel;        /* NULL: not mapped */
    size_t size;            /* bytes */
    int stride;             /* pixels */
};

struct kms {
    int card; /* file descriptor; -1: closed */
    uint32_t connector, crtc;
    drmModeModeInfo mode;
    drmModeCrtc *before; /* the mode before kms_open(); NULL: not known */
    struct kms_buffer buffer[2];
    int hidden;    /* the buffer that is not shown */
    bool lit;      /* the mode is set, and one buffer is shown */
    bool flipping; /* a flip to the other buffer was requested, and is not confirmed yet */
    char name[64]; /* of output and mode */
};

static char reason[200];

__attribute__((format(printf, 1, 2))) static const char *because(const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(reason, sizeof reason, format, arguments);
    va_end(arguments);
    return reason;
}

/* ---- Choice of output and mode ---- */

static void name_of(const drmModeConnector *connector, char *name, size_t size) {
    const char *type = drmModeGetConnectorTypeName(connector->connector_type);

    snprintf(name, size, "%s-%u", type ? type : "Unknown", connector->connector_type_id);
}

static bool is_better(const drmModeModeInfo *mode, const drmModeModeInfo *than, const struct screen_choice *choice) {
    if (choice->width)
        return !than || mode->vrefresh > than->vrefresh;
    return !than || (mode->type & DRM_MODE_TYPE_PREFERRED && !(than->type & DRM_MODE_TYPE_PREFERRED));
}

/* The mode of this size that refreshes most often, or the one that the monitor prefers. NULL: no such mode. */
static const drmModeModeInfo *mode_of(const drmModeConnector *connector, const struct screen_choice *choice) {
    const drmModeModeInfo *found = NULL;

    for (int i = 0; i < connector->count_modes; i++) {
        const drmModeModeInfo *mode = &connector->modes[i];

        bool fits = !choice->width || (choice->width == mode->hdisplay && choice->height == mode->vdisplay);
        if (fits && !(mode->flags & DRM_MODE_FLAG_INTERLACE) && is_better(mode, found, choice))
            found = mode;
    }
    return found;
}

/* The part of the card that drives the connector, or can drive it. 0: none. */
static uint32_t crtc_of(int card, const drmModeRes *resources, const drmModeConnector *connector) {
    uint32_t found = 0;

    for (int i = 0; i < connector->count_encoders && !found; i++) {
        drmModeEncoder *encoder = drmModeGetEncoder(card, connector->encoders[i]);

        if (!encoder)
            continue;
        if (encoder->encoder_id == connector->encoder_id)
            found = encoder->crtc_id;
        for (int k = 0; k < resources->count_crtcs && !found; k++)
            if (encoder->possible_crtcs & 1u << k)
                found = resources->crtcs[k];
        drmModeFreeEncoder(encoder);
    }
    return found;
}

static const char *choose_mode(struct kms *kms, const drmModeRes *resources, const drmModeConnector *connector,
                               const struct screen_choice *choice) {
    char name[32];
    const drmModeModeInfo *mode = mode_of(connector, choice);

    name_of(connector, name, sizeof name);
    if (connector->connection != DRM_MODE_CONNECTED)
        return because("no monitor at %s", name);
    if (!mode && choice->width)
        return because("%s: the monitor has no mode %dx%d", name, choice->width, choice->height);
    if (!mode)
        return because("%s: the monitor has no mode", name);
    kms->connector = connector->connector_id;
    kms->crtc = crtc_of(kms->card, resources, connector);
    kms->mode = *mode;
    snprintf(kms->name, sizeof kms->name, "%s, %ux%u at %u Hz", name, mode->hdisplay, mode->vdisplay, mode->vrefresh);
    return kms->crtc ? NULL : because("%s: the graphics card has no free part for it", name);
}

/* The requested output, or the first with a monitor. Asks each monitor for its modes. */
static const char *choose_output(struct kms *kms, const drmModeRes *resources, const struct screen_choice *choice) {
    const char *wrong = choice->output ? because("no output %s", choice->output) : because("no monitor");
    bool found = false;

    for (int i = 0; i < resources->count_connectors && !found; i++) {
        drmModeConnector *connector = drmModeGetConnector(kms->card, resources->connectors[i]);
        char name[32];

        if (!connector)
            continue;
        name_of(connector, name, sizeof name);
        found = choice->output ? !strcmp(name, choice->output) : connector->connection == DRM_MODE_CONNECTED;
        if (found)
            wrong = choose_mode(kms, resources, connector, choice);
        else if (choice->output)
            snprintf(reason + strlen(reason), sizeof reason - strlen(reason), "%s %s",
                     strchr(reason, ';') ? "," : "; there is", name);
        drmModeFreeConnector(connector);
    }
    return wrong;
}

/* ---- Buffers ---- */

static const char *make_buffer(struct kms *kms, struct kms_buffer *buffer) {
    uint32_t pitch;
    uint64_t size, offset;

    if (drmModeCreateDumbBuffer(kms->card, kms->mode.hdisplay, kms->mode.vdisplay, BITS, 0, &buffer->handle, &pitch,
                                &size))
        return because("no memory of the graphics card for %s", kms->name);
    buffer->size = size;
    buffer->stride = (int)(pitch / sizeof *buffer->pixel);
    if (drmModeAddFB(kms->card, kms->mode.hdisplay, kms->mode.vdisplay, DEPTH, BITS, pitch, buffer->handle,
                     &buffer->frame) ||
        drmModeMapDumbBuffer(kms->card, buffer->handle, &offset))
        return because("the graphics card does not show pixels of 32 bits: %s", strerror(errno));
    void *place = mmap(NULL, buffer->size, PROT_READ | PROT_WRITE, MAP_SHARED, kms->card, (off_t)offset);
    if (place == MAP_FAILED)
        return because("the memory of the graphics card cannot be mapped: %s", strerror(errno));
    buffer->pixel = place;
    memset(buffer->pixel, 0, buffer->size);
    return NULL;
}

static void drop_buffer(const struct kms *kms, struct kms_buffer *buffer) {
    if (buffer->pixel)
        munmap(buffer->pixel, buffer->size);
    if (buffer->frame)
        drmModeRmFB(kms->card, buffer->frame);
    if (buffer->handle)
        drmModeDestroyDumbBuffer(kms->card, buffer->handle);
}

/* ---- The card ---- */

static const char *open_output(struct kms *kms, const struct screen_choice *choice) {
    uint64_t dumb = 0;
    drmModeRes *resources = drmModeGetResources(kms->card);
    const char *wrong = "the graphics card has no output";

    if (resources && !drmGetCap(kms->card, DRM_CAP_DUMB_BUFFER, &dumb) && dumb)
        wrong = choose_output(kms, resources, choice);
    drmModeFreeResources(resources);
    /* A program that opens a free card becomes its master. */
    if (!wrong && !drmIsMaster(kms->card))
        wrong = because("%s: the screen is in use by another program", kms->name);
    if (!wrong)
        kms->before = drmModeGetCrtc(kms->card, kms->crtc);
    if (!wrong)
        wrong = make_buffer(kms, &kms->buffer[0]);
    if (!wrong)
        wrong = make_buffer(kms, &kms->buffer[1]);
    return wrong;
}

/* The kernel does this as well, but switches the screen off first. */
static void show_before(struct kms *kms) {
    drmModeCrtc *before = kms->before;

    if (kms->lit && before && before->buffer_id && before->mode_valid)
        drmModeSetCrtc(kms->card, kms->crtc, before->buffer_id, before->x, before->y, &kms->connector, 1,
                       &before->mode);
    drmModeFreeCrtc(before);
}

static void kms_close(struct kms *kms) {
    show_before(kms);
    drop_buffer(kms, &kms->buffer[0]);
    drop_buffer(kms, &kms->buffer[1]);
    close(kms->card);
    *kms = (struct kms){.card = -1};
}

static const char *kms_open(struct kms *kms, const struct screen_choice *choice) {
    const char *wrong = NULL;

    for (int i = 0; i < CARDS; i++) {
        char path[32];

        *kms = (struct kms){.card = -1};
        snprintf(path, sizeof path, "/dev/dri/card%d", i);
        kms->card = open(path, O_RDWR | O_CLOEXEC);
        if (kms->card < 0) {
            if (errno != ENOENT && !wrong)
                wrong = because("%s: %s", path, strerror(errno));
            continue;
        }
        const char *said = open_output(kms, choice);
        if (!said)
            return NULL;
        wrong = said;
        kms_close(kms);
    }
    return wrong ? wrong : "no screen: no driver has made /dev/dri/card0";
}

/* Whether the kernel knows of the monitor; the monitor itself is not asked. */
static bool kms_connected(const struct kms *kms) {
    drmModeConnector *connector = drmModeGetConnectorCurrent(kms->card, kms->connector);
    bool connected = connector && connector->connection != DRM_MODE_DISCONNECTED;

    drmModeFreeConnector(connector);
    return connected;
}

/* ---- Flips ---- */

static void on_flip(int card, unsigned sequence, unsigned seconds, unsigned microseconds, void *data) {
    struct kms *kms = data;

    (void)card, (void)sequence, (void)seconds, (void)microseconds;
    kms->flipping = false;
}

/* Call when the card's descriptor is readable: marks a flip as done. */
static void kms_read(struct kms *kms) {
    drmEventContext context = {.version = 2, .page_flip_handler = on_flip};

    drmHandleEvent(kms->card, &context);
}

/* Waits until the hidden buffer is no longer on the screen: at most one refresh. */
static const char *kms_wait(struct kms *kms) {
    while (kms->flipping) {
        struct pollfd entry = {.fd = kms->card, .events = POLLIN};
        int ready = poll(&entry, 1, PATIENCE_MS);

        if (ready < 0 && errno == EINTR)
            continue;
        if (ready <= 0 || !(entry.revents & POLLIN))
            return because("%s: the screen does not refresh", kms->name);
        kms_read(kms);
    }
    return NULL;
}

/* Show the hidden buffer from the next refresh on; the other one becomes the hidden one. */
static const char *kms_flip(struct kms *kms) {
    uint32_t frame = kms->buffer[kms->hidden].frame;

    if (!kms->lit && drmModeSetCrtc(kms->card, kms->crtc, frame, 0, 0, &kms->connector, 1, &kms->mode))
        return because("%s: the mode cannot be set: %s", kms->name, strerror(errno));
    if (kms->lit && drmModePageFlip(kms->card, kms->crtc, frame, DRM_MODE_PAGE_FLIP_EVENT, kms))
        return because("%s: no page flip: %s", kms->name, strerror(errno));
    kms->flipping = kms->lit;
    kms->lit = true;
    kms->hidden = 1 - kms->hidden;
    return NULL;
}

/* ---- The output as a surface ---- */

#define LOOK_NS (1000 * MS) /* between checks for the monitor */

struct screen {
    struct surface surface;
    struct kms kms;
    struct keys keys;
    int waker;
    int64_t looked; /* ns of CLOCK_MONOTONIC */
};

static void screen_size(struct surface *surface, int *width, int *height) {
    const struct screen *screen = (const struct screen *)surface;

    *width = screen->kms.mode.hdisplay;
    *height = screen->kms.mode.vdisplay;
}

static bool is_unplugged(struct screen *screen) {
    int64_t now = ddx_time_now();

    if (now - screen->looked < LOOK_NS)
        return false;
    screen->looked = now;
    return !kms_connected(&screen->kms);
}

static const char *screen_lock(struct surface *surface, struct canvas *canvas) {
    struct screen *screen = (struct screen *)surface;
    const char *wrong = kms_wait(&screen->kms);
    const struct kms_buffer *buffer = &screen->kms.buffer[screen->kms.hidden];

    if (!wrong && is_unplugged(screen))
        wrong = "the monitor is unplugged";
    if (!wrong)
        *canvas = (struct canvas){buffer->pixel, buffer->stride, screen->kms.mode.hdisplay, screen->kms.mode.vdisplay};
    return wrong;
}

static const char *screen_show(struct surface *surface) {
    return kms_flip(&((struct screen *)surface)->kms);
}

/* ---- Events ---- */

/* The next event that has already happened; does not wait. */
static bool next(struct screen *screen, struct surface_event *event) {
    eventfd_t count;
    int key = keys_next(&screen->keys, ddx_time_now());

    *event = (struct surface_event){.kind = key ? SURFACE_KEY : SURFACE_WAKE, .key = key};
    return key || !eventfd_read(screen->waker, &count);
}

/* A part of the wait. False: the terminal is gone. */
static bool wait_once(struct screen *screen, int timeout) {
    enum keys_state state = keys_ready(&screen->keys);
    struct pollfd entry[] = {{.fd = screen->waker, .events = POLLIN},
                             {.fd = screen->kms.flipping ? screen->kms.card : -1, .events = POLLIN},
                             {.fd = state == KEYS_LISTEN ? STDIN_FILENO : -1, .events = POLLIN}};

    if (state == KEYS_GONE)
        return false;
    if (screen->keys.count && timeout > KEYS_ESCAPE_MS)
        timeout = KEYS_ESCAPE_MS;
    if (poll(entry, sizeof entry / sizeof *entry, timeout) <= 0)
        return true;
    if (entry[1].revents & POLLIN)
        kms_read(&screen->kms);
    return !entry[2].revents || keys_read(&screen->keys);
}

static bool screen_event(struct surface *surface, struct surface_event *event, int timeout) {
    struct screen *screen = (struct screen *)surface;
    int64_t end = ddx_time_now() + timeout * MS, left;

    for (;;) {
        if (next(screen, event))
            return true;
        left = end - ddx_time_now();
        if (!wait_once(screen, left > 0 ? (int)((left + MS - 1) / MS) : 0)) {
            *event = (struct surface_event){.kind = SURFACE_CLOSE};
            return true;
        }
        if (left <= 0)
            return next(screen, event);
    }
}

static void screen_wake(struct surface *surface) {
    eventfd_write(((struct screen *)surface)->waker, 1);
}

/* ---- The screen ---- */

static void screen_close(struct surface *surface) {
    struct screen *screen = (struct screen *)surface;

    keys_close(&screen->keys);
    kms_close(&screen->kms);
    close(screen->waker);
    free(screen);
}

struct surface *screen_open(const struct screen_choice *choice, const char **error) {
    struct screen *screen = calloc(1, sizeof *screen);

    *error = "out of memory";
    if (!screen)
        return NULL;
    screen->surface = (struct surface){.size = screen_size,
                                       .lock = screen_lock,
                                       .show = screen_show,
                                       .event = screen_event,
                                       .wake = screen_wake,
                                       .close = screen_close};
    screen->waker = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    *error = screen->waker < 0 ? "no file descriptor left" : kms_open(&screen->kms, choice);
    if (*error) {
        if (screen->waker >= 0)
            close(screen->waker);
        free(screen);
        return NULL;
    }
    if (choice->keys)
        keys_open(&screen->keys);
    return &screen->surface;
}

const char *screen_name(const struct surface *surface) {
    return ((const struct screen *)surface)->kms.name;
}

#else

struct surface *screen_open(const struct screen_choice *choice, const char **error) {
    (void)choice;
    *error = "built without libdrm";
    return NULL;
}

const char *screen_name(const struct surface *surface) {
    (void)surface;
    return "";
}

#endif
