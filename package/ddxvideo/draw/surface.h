/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Programs draw on a surface: a window or, without X, a whole screen. Each back end has its own struct that
 * begins with a struct surface.
 *
 * A surface belongs to one thread; only surface_wake() may be called from any thread. Two functions wait:
 * surface_event() for at most the given time, and surface_lock() of a screen for at most one refresh.
 */
#ifndef DDXVIDEO_SURFACE_H
#define DDXVIDEO_SURFACE_H

#include <stdbool.h>
#include <stdint.h>

/* The screen to use, and its mode. */
struct screen_choice {
    const char *output; /* a connector's name, such as "HDMI-A-1"; NULL: the first with a monitor */
    int width, height;  /* of the mode, pixels; 0: the mode that the monitor prefers */
    bool keys;          /* report keys of the terminal on standard input as events */
};

/* Pixels to be filled: 0x00RRGGBB, rows from the top. */
struct canvas {
    uint32_t *pixel;
    int stride; /* pixels from row to row */
    int width, height;
};

enum surface_event_kind {
    SURFACE_KEY,     /* key */
    SURFACE_POINTER, /* x, y; held: a button is down */
    SURFACE_BUTTON,  /* x, y; held: pressed, otherwise released */
    SURFACE_WHEEL,   /* x, y; steps: above 0 away from the user */
    SURFACE_RESIZE,  /* the size has changed, or the content was lost: draw again */
    SURFACE_WAKE,    /* surface_wake() was called */
    SURFACE_CLOSE
};

/* Keys are Unicode characters by the keyboard's layout ('?', '.'), and these. */
enum surface_key {
    SURFACE_ESCAPE = 27,
    SURFACE_LEFT = 0x110000, /* beyond Unicode */
    SURFACE_RIGHT,
    SURFACE_UP,
    SURFACE_DOWN,
    SURFACE_HOME,
    SURFACE_END
};

struct surface_event {
    enum surface_event_kind kind;
    int key;
    int x, y; /* of the pointer, pixels from the top left of the canvas */
    bool held;
    int steps;
};

struct surface {
    void (*size)(struct surface *surface, int *width, int *height);
    const char *(*lock)(struct surface *surface, struct canvas *canvas);
    const char *(*show)(struct surface *surface);
    bool (*event)(struct surface *surface, struct surface_event *event, int timeout);
    void (*wake)(struct surface *surface);
    void (*close)(struct surface *surface);
    /* NULL for a screen: */
    void (*resize)(struct surface *surface, int width, int height);
    void (*full)(struct surface *surface, bool full);
    void (*title)(struct surface *surface, const char *title);
};

/* The size that surface_lock() will give, pixels. */
static inline void surface_size(struct surface *surface, int *width, int *height) {
    surface->size(surface, width, height);
}

/*
 * Give the pixels for the next picture. Their content is undefined, so all of them must be drawn. They are valid until
 * surface_show(), which must follow. Returns NULL, or the reason of a failure as a static text; then nothing is locked.
 */
static inline const char *surface_lock(struct surface *surface, struct canvas *canvas) {
    return surface->lock(surface, canvas);
}

/* Show the drawn picture. Returns NULL, or the reason of a failure. */
static inline const char *surface_show(struct surface *surface) {
    return surface->show(surface);
}

/* Wait at most `timeout` ms for the next event; 0 does not wait. False if there is none. */
static inline bool surface_event(struct surface *surface, struct surface_event *event, int timeout) {
    return surface->event(surface, event, timeout);
}

/* Let surface_event() return now, with SURFACE_WAKE. From any thread. */
static inline void surface_wake(struct surface *surface) {
    surface->wake(surface);
}

/* Request this size, and show a window that is still hidden. A screen does not change. */
static inline void surface_resize(struct surface *surface, int width, int height) {
    if (surface->resize)
        surface->resize(surface, width, height);
}

/* Enter or leave full screen. A screen does not change. */
static inline void surface_full(struct surface *surface, bool full) {
    if (surface->full)
        surface->full(surface, full);
}

/* The text on a window's frame, UTF-8. A screen has none. */
static inline void surface_title(struct surface *surface, const char *title) {
    if (surface->title)
        surface->title(surface, title);
}

/* NULL is allowed. */
static inline void surface_close(struct surface *surface) {
    if (surface)
        surface->close(surface);
}

/* ---- A window. SDL2 is loaded at run time, so that a machine without a screen does not need it. ---- */

/*
 * Open a window, which is visible from the first surface_resize() on. It is the caller's until surface_close(); a
 * program has one at a time. NULL, with the reason in *error as a static text.
 */
struct surface *window_open(const char *title, const char **error);

/* ---- A whole screen, without X: two buffers and page flips of the kernel's DRM, so no picture is torn. ---- */

/*
 * Open a screen that no other program uses. The text console returns after surface_close(), and after the program's
 * death. Drivers may need some 100 ms to ask the monitors. The screen is the caller's until surface_close(); a program
 * has one at a time. NULL, with the reason in *error as a static text, valid until the next call: no screen, no
 * monitor, no such output or mode, in use, no permission. A caller may try again at any time.
 *
 * An error of surface_lock() or surface_show() means that the screen is lost (its monitor was unplugged, say): close
 * the surface, and open another one.
 *
 * Keys are read, and the terminal is changed, only while the program is in the foreground of its terminal: in the
 * background neither is touched, and SIGTTIN and SIGTTOU do not occur. There are no events of a pointer, and
 * SURFACE_CLOSE means that the terminal is gone.
 */
struct surface *screen_open(const struct screen_choice *choice, const char **error);

/* The connector's name and the mode, such as "HDMI-A-1, 1920x1080 at 60 Hz". Valid until surface_close(). */
const char *screen_name(const struct surface *surface);

#endif
