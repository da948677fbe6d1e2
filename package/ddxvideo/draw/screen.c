/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "surface.h"

#include <stdio.h>
#include <stdlib.h>

#ifdef WITH_DRM
#include <ddx.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "ddx_time.h"
#include "keys.h"
#include "kms.h"

#define LOOK (1000 * MS) /* between checks for the monitor */

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

    if (now - screen->looked < LOOK)
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
