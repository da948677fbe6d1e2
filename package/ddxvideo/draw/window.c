/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "surface.h"

#include <stdio.h>
#include <stdlib.h>

#ifdef WITH_SDL2
#include <SDL2/SDL.h>
#include <SDL2/SDL_syswm.h>
#include <dlfcn.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

/* Loaded when a window is requested, so that a machine without a screen needs neither SDL2 nor SDL2's libraries. */
/* clang-format off */
#define FUNCTIONS(X)                                                                                              \
    X(Init) X(Quit) X(GetError) X(SetHint) X(PollEvent) X(WaitEventTimeout) X(GetWindowWMInfo) X(CreateWindow)    \
    X(SetWindowSize) X(SetWindowPosition) X(GetWindowSize) X(ShowWindow) X(SetWindowFullscreen) X(SetWindowTitle) \
    X(GetWindowSurface) X(UpdateWindowSurface) X(LockSurface) X(UnlockSurface) X(ConvertPixels)
/* clang-format on */
#define LIBRARY "libSDL2-2.0.so.0"
#define WIDTH 352 /* until the caller's first surface_resize() */
#define HEIGHT 288
#define SLICE_MS 5 /* where no descriptor to wait for is known */

struct window {
    struct surface surface;
    void *library;
#define DECLARE(name) __typeof__(&SDL_##name) name;
    FUNCTIONS(DECLARE)
    SDL_Window *window;
    bool seen;
    int wake;            /* an eventfd */
    int connection;      /* connection to the X server; -1: there is none */
    SDL_Surface *target; /* locked */
    uint32_t *pixel;     /* for drawing, if the window's own pixels have another format; otherwise NULL */
};

static bool load(struct window *window) {
    window->library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
    if (!window->library)
        return false;
#define LOAD(name) *(void **)(void *)&window->name = dlsym(window->library, "SDL_" #name);
    FUNCTIONS(LOAD)
#define IS_THERE(name) &&window->name
    return true FUNCTIONS(IS_THERE);
}

static void window_size(struct surface *surface, int *width, int *height) {
    struct window *window = (struct window *)surface;

    window->GetWindowSize(window->window, width, height);
}

static bool is_plain(const SDL_Surface *target) {
    return target->format->format == SDL_PIXELFORMAT_RGB888 || target->format->format == SDL_PIXELFORMAT_ARGB8888;
}

static const char *window_lock(struct surface *surface, struct canvas *canvas) {
    struct window *window = (struct window *)surface;
    SDL_Surface *target = window->GetWindowSurface(window->window);

    if (!target || window->LockSurface(target))
        return window->GetError();
    *canvas = (struct canvas){target->pixels, target->pitch / 4, target->w, target->h};
    if (!is_plain(target)) {
        canvas->stride = target->w;
        canvas->pixel = window->pixel = malloc((size_t)target->w * (size_t)target->h * sizeof *window->pixel);
    }
    if (!canvas->pixel) {
        window->UnlockSurface(target);
        return "out of memory";
    }
    window->target = target;
    return NULL;
}

static const char *window_show(struct surface *surface) {
    struct window *window = (struct window *)surface;
    SDL_Surface *target = window->target;

    if (window->pixel)
        window->ConvertPixels(target->w, target->h, SDL_PIXELFORMAT_RGB888, window->pixel, target->w * 4,
                              target->format->format, target->pixels, target->pitch);
    free(window->pixel);
    window->pixel = NULL;
    window->UnlockSurface(target);
    return window->UpdateWindowSurface(window->window) ? window->GetError() : NULL;
}

/* ---- Events ---- */

/* Keys without a character; 0: all others. */
static int special(SDL_Keycode code) {
    switch (code) {
    case SDLK_ESCAPE: return SURFACE_ESCAPE;
    case SDLK_LEFT: return SURFACE_LEFT;
    case SDLK_RIGHT: return SURFACE_RIGHT;
    case SDLK_UP: return SURFACE_UP;
    case SDLK_DOWN: return SURFACE_DOWN;
    case SDLK_HOME: return SURFACE_HOME;
    case SDLK_END: return SURFACE_END;
    default: return 0;
    }
}

static int wheel_steps(const SDL_MouseWheelEvent *wheel) {
    return wheel->direction == SDL_MOUSEWHEEL_FLIPPED ? -wheel->y : wheel->y;
}

/* False: no event of surface.h. */
static bool translate(const SDL_Event *from, struct surface_event *to) {
    *to = (struct surface_event){.kind = SURFACE_KEY};
    switch (from->type) {
    case SDL_QUIT: to->kind = SURFACE_CLOSE; return true;
    case SDL_TEXTINPUT: /* keys with a character, by the keyboard's layout */
        to->key = (unsigned char)from->text.text[0];
        return to->key < 0x80;
    case SDL_KEYDOWN: to->key = special(from->key.keysym.sym); return to->key != 0;
    case SDL_MOUSEMOTION:
        *to = (struct surface_event){SURFACE_POINTER, 0, from->motion.x, from->motion.y, from->motion.state != 0, 0};
        return true;
    case SDL_MOUSEBUTTONDOWN:
    case SDL_MOUSEBUTTONUP:
        *to = (struct surface_event){
            SURFACE_BUTTON, 0, from->button.x, from->button.y, from->button.state == SDL_PRESSED, 0};
        return true;
    case SDL_MOUSEWHEEL:
        *to = (struct surface_event){SURFACE_WHEEL,      0,     from->wheel.mouseX,
                                     from->wheel.mouseY, false, wheel_steps(&from->wheel)};
        return true;
    case SDL_WINDOWEVENT:
        to->kind = SURFACE_RESIZE;
        return from->window.event == SDL_WINDOWEVENT_SIZE_CHANGED || from->window.event == SDL_WINDOWEVENT_EXPOSED;
    default: return false;
    }
}

/* False: no event has come. */
static bool take_event(struct window *window, struct surface_event *event) {
    eventfd_t count;
    SDL_Event from;

    while (window->PollEvent(&from))
        if (translate(&from, event))
            return true;
    *event = (struct surface_event){.kind = SURFACE_WAKE};
    return !eventfd_read(window->wake, &count);
}

/* Wait for the window system or for surface_wake(); `timeout`: ms. */
static void wait_for_event(struct window *window, int timeout) {
    struct pollfd wanted[2] = {{.fd = window->wake, .events = POLLIN}, {.fd = window->connection, .events = POLLIN}};

    if (window->connection >= 0)
        poll(wanted, 2, timeout);
    for (int waited = 0; window->connection < 0 && waited < timeout && !poll(wanted, 1, 0); waited += SLICE_MS)
        if (window->WaitEventTimeout(NULL, timeout < SLICE_MS ? timeout : SLICE_MS))
            return;
}

static bool window_event(struct surface *surface, struct surface_event *event, int timeout) {
    struct window *window = (struct window *)surface;

    if (take_event(window, event))
        return true;
    if (timeout <= 0)
        return false;
    wait_for_event(window, timeout);
    return take_event(window, event);
}

/*
 * Without an event of SDL: from another thread, SDL sends an event through a second connection to the X server, and
 * the program exits if the server does not know the window yet, or no longer knows it.
 */
static void window_wake(struct surface *surface) {
    eventfd_write(((struct window *)surface)->wake, 1);
}

/* ---- The window ---- */

static void window_resize(struct surface *surface, int width, int height) {
    struct window *window = (struct window *)surface;

    window->SetWindowSize(window->window, width, height);
    if (!window->seen) /* its place was chosen for another size */
        window->SetWindowPosition(window->window, SDL_WINDOWPOS_CENTERED, SDL_WINDOWPOS_CENTERED);
    window->seen = true;
    window->ShowWindow(window->window);
}

static void window_full(struct surface *surface, bool full) {
    struct window *window = (struct window *)surface;

    window->SetWindowFullscreen(window->window, full ? SDL_WINDOW_FULLSCREEN_DESKTOP : 0);
}

static void window_title(struct surface *surface, const char *title) {
    struct window *window = (struct window *)surface;

    window->SetWindowTitle(window->window, title);
}

static void window_close(struct surface *surface) {
    struct window *window = (struct window *)surface;

    window->Quit();
    close(window->wake);
    free(window->pixel);
    free(window);
}

/* The descriptor for poll(); -1: not known. */
static int connection_of(struct window *window) {
    SDL_SysWMinfo info;

    SDL_VERSION(&info.version);
    if (!window->GetWindowWMInfo(window->window, &info))
        return -1;
#ifdef SDL_VIDEO_DRIVER_X11
    if (info.subsystem == SDL_SYSWM_X11)
        return ConnectionNumber(info.info.x11.display);
#endif
    return -1;
}

struct surface *window_open(const char *title, const char **error) {
    struct window *window = calloc(1, sizeof *window);

    *error = "out of memory";
    if (!window)
        return NULL;
    window->surface = (struct surface){window_size,  window_lock,   window_show, window_event, window_wake,
                                       window_close, window_resize, window_full, window_title};
    window->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (!load(window)) {
        *error = "no library " LIBRARY;
        close(window->wake);
        free(window);
        return NULL;
    }
    /* Pictures are drawn in memory; a graphics processor would only slow down the start. */
    window->SetHint(SDL_HINT_FRAMEBUFFER_ACCELERATION, "0");
    window->SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
    window->SetHint(SDL_HINT_VIDEO_ALLOW_SCREENSAVER, "1");
    if (!window->Init(SDL_INIT_VIDEO))
        window->window = window->CreateWindow(title, SDL_WINDOWPOS_UNDEFINED, SDL_WINDOWPOS_UNDEFINED, WIDTH, HEIGHT,
                                              SDL_WINDOW_RESIZABLE | SDL_WINDOW_HIDDEN);
    if (window->window) {
        window->connection = connection_of(window);
        return &window->surface;
    }
    static char text[200];
    snprintf(text, sizeof text, "%s", window->GetError()); /* SDL's own text goes with Quit() */
    *error = text;
    window_close(&window->surface);
    return NULL;
}

#else

struct surface *window_open(const char *title, const char **error) {
    (void)title;
    *error = "built without SDL2";
    return NULL;
}

#endif
