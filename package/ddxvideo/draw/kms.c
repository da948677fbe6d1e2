/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "kms.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>

#define CARDS 8
#define PATIENCE 1000 /* ms; a card whose flip takes longer does not refresh at all */
#define DEPTH 24
#define BITS 32

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

const char *kms_open(struct kms *kms, const struct screen_choice *choice) {
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

/* The kernel does this as well, but switches the screen off first. */
static void show_before(struct kms *kms) {
    drmModeCrtc *before = kms->before;

    if (kms->lit && before && before->buffer_id && before->mode_valid)
        drmModeSetCrtc(kms->card, kms->crtc, before->buffer_id, before->x, before->y, &kms->connector, 1,
                       &before->mode);
    drmModeFreeCrtc(before);
}

void kms_close(struct kms *kms) {
    show_before(kms);
    drop_buffer(kms, &kms->buffer[0]);
    drop_buffer(kms, &kms->buffer[1]);
    close(kms->card);
    *kms = (struct kms){.card = -1};
}

bool kms_connected(const struct kms *kms) {
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

void kms_read(struct kms *kms) {
    drmEventContext context = {.version = 2, .page_flip_handler = on_flip};

    drmHandleEvent(kms->card, &context);
}

const char *kms_wait(struct kms *kms) {
    while (kms->flipping) {
        struct pollfd entry = {.fd = kms->card, .events = POLLIN};
        int ready = poll(&entry, 1, PATIENCE);

        if (ready < 0 && errno == EINTR)
            continue;
        if (ready <= 0 || !(entry.revents & POLLIN))
            return because("%s: the screen does not refresh", kms->name);
        kms_read(kms);
    }
    return NULL;
}

const char *kms_flip(struct kms *kms) {
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
