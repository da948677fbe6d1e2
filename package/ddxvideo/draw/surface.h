/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What programs draw on: a window (window.h) or, without X, a whole screen. Each back end has a struct of its own that
 * begins with a struct surface.
 *
 * A surface belongs to one thread; only surface_wake() may be called from any thread. Nothing here waits but
 * surface_event(), for at most the time that it is given, and surface_lock() of a screen, for at most one refresh.
 */
#ifndef DDXVIDEO_SURFACE_H
#define DDXVIDEO_SURFACE_H

#include <stdbool.h>
#include <stdint.h>

/* Pixels to be filled: 0x00RRGGBB, rows from the top. */
struct canvas {
    uint32_t *pixel;
    int stride; /* pixels from row to row */
    int width, height;
};

enum surface_event_kind {
    SURFACE_KEY,     /* key */
    SURFACE_POINTER, /* x, y; held: a button is down */
    SURFACE_BUTTON,  /* x, y; held: it went down, else up */
    SURFACE_WHEEL,   /* x, y; steps: above 0 away from the user */
    SURFACE_RESIZE,  /* the size is another one, or what was shown is gone: draw again */
    SURFACE_WAKE,    /* surface_wake() was called */
    SURFACE_CLOSE
};

/* Keys are Unicode characters as the keyboard's layout gives them ('?', '.'), and these. */
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
    void (*resize)(struct surface *surface, int width, int height);
    void (*full)(struct surface *surface, bool full);
    void (*title)(struct surface *surface, const char *title);
    void (*close)(struct surface *surface);
};

/* The size that surface_lock() will give, pixels. */
static inline void surface_size(struct surface *surface, int *width, int *height) {
    surface->size(surface, width, height);
}

/*
 * Pixels to draw the next picture in, all of them: their content is undefined. Valid until surface_show(), which has to
 * follow. NULL, or what went wrong, as a static text: then nothing is locked.
 */
static inline const char *surface_lock(struct surface *surface, struct canvas *canvas) {
    return surface->lock(surface, canvas);
}

/* Show what was drawn. NULL, or what went wrong. */
static inline const char *surface_show(struct surface *surface) {
    return surface->show(surface);
}

/* The next event, waited for at most `timeout` ms; 0 does not wait. False if there is none. */
static inline bool surface_event(struct surface *surface, struct surface_event *event, int timeout) {
    return surface->event(surface, event, timeout);
}

/* Let surface_event() return now, with SURFACE_WAKE. From any thread. */
static inline void surface_wake(struct surface *surface) {
    surface->wake(surface);
}

/* Ask for this size, and let a window be seen that is not seen yet. A screen stays as it is. */
static inline void surface_resize(struct surface *surface, int width, int height) {
    surface->resize(surface, width, height);
}

/* Take the full screen with a window, or give it back. A screen stays as it is. */
static inline void surface_full(struct surface *surface, bool full) {
    surface->full(surface, full);
}

/* The text on a window's frame, UTF-8. A screen has none. */
static inline void surface_title(struct surface *surface, const char *title) {
    surface->title(surface, title);
}

/* NULL is allowed. */
static inline void surface_close(struct surface *surface) {
    if (surface)
        surface->close(surface);
}

#endif
