/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "display.h"

#include <stdio.h>
#include <stdlib.h>

#ifdef WITH_SDL2
#include <SDL2/SDL.h>
#include <dlfcn.h>

/* Looked up when a window is wanted, so that a machine without a screen needs neither SDL2 nor what SDL2 needs. */
/* clang-format off */
#define FUNCTIONS(X)                                                                                              \
    X(Init) X(Quit) X(GetError) X(PollEvent) X(CreateWindow) X(SetWindowSize) X(ShowWindow) X(CreateRenderer)     \
    X(CreateTexture) X(DestroyTexture) X(UpdateYUVTexture) X(RenderSetLogicalSize) X(RenderClear) X(RenderCopy)   \
    X(RenderPresent)
/* clang-format on */
#define LIBRARY "libSDL2-2.0.so.0"

struct display {
    void *library;
#define DECLARE(name) __typeof__(&SDL_##name) name;
    FUNCTIONS(DECLARE)
    SDL_Window *window;
    SDL_Renderer *renderer;
    SDL_Texture *texture;
    int width, height;
};

static bool load(struct display *display) {
    display->library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
    if (!display->library)
        return false;
#define LOAD(name) *(void **)(void *)&display->name = dlsym(display->library, "SDL_" #name);
    FUNCTIONS(LOAD)
#define IS_THERE(name) &&display->name
    return true FUNCTIONS(IS_THERE);
}

struct display *display_open(const char *title, const char **error) {
    struct display *display = calloc(1, sizeof *display);

    *error = "out of memory";
    if (!display)
        return NULL;
    if (!load(display)) {
        *error = "no library " LIBRARY;
        free(display);
        return NULL;
    }
    if (!display->Init(SDL_INIT_VIDEO))
        display->window = display->CreateWindow(title, SDL_WINDOWPOS_UNDEFINED, SDL_WINDOWPOS_UNDEFINED, 352, 288,
                                                SDL_WINDOW_RESIZABLE | SDL_WINDOW_HIDDEN);
    if (display->window)
        display->renderer = display->CreateRenderer(display->window, -1, 0); /* no wait for the screen's beam */
    if (display->renderer)
        return display;
    static char text[200];
    snprintf(text, sizeof text, "%s", display->GetError()); /* SDL's own text goes with Quit() */
    *error = text;
    display->Quit();
    free(display);
    return NULL;
}

static bool resize(struct display *display, const AVFrame *picture) {
    if (display->texture && display->width == picture->width && display->height == picture->height)
        return true;
    if (display->texture)
        display->DestroyTexture(display->texture);
    display->width = picture->width;
    display->height = picture->height;
    display->texture = display->CreateTexture(display->renderer, SDL_PIXELFORMAT_IYUV, SDL_TEXTUREACCESS_STREAMING,
                                              picture->width, picture->height);
    display->SetWindowSize(display->window, picture->width, picture->height);
    display->ShowWindow(display->window);
    display->RenderSetLogicalSize(display->renderer, picture->width, picture->height); /* bars beside, not distortion */
    return display->texture;
}

const char *display_show(struct display *display, const AVFrame *picture) {
    if (!resize(display, picture) ||
        display->UpdateYUVTexture(display->texture, NULL, picture->data[0], picture->linesize[0], picture->data[1],
                                  picture->linesize[1], picture->data[2], picture->linesize[2]) ||
        display->RenderClear(display->renderer) || display->RenderCopy(display->renderer, display->texture, NULL, NULL))
        return display->GetError();
    display->RenderPresent(display->renderer);
    return NULL;
}

bool display_tick(struct display *display) {
    SDL_Event event;
    bool open = true;

    while (display->PollEvent(&event)) {
        if (event.type == SDL_QUIT)
            open = false;
        if (event.type == SDL_KEYDOWN)
            open &= event.key.keysym.sym != SDLK_ESCAPE && event.key.keysym.sym != SDLK_q;
    }
    return open;
}

void display_close(struct display *display) {
    if (!display)
        return;
    display->Quit();
    free(display);
}

#else

struct display *display_open(const char *title, const char **error) {
    (void)title;
    *error = "built without SDL2";
    return NULL;
}

void display_close(struct display *display) {
    (void)display;
}

const char *display_show(struct display *display, const AVFrame *picture) {
    (void)display;
    (void)picture;
    return NULL;
}

bool display_tick(struct display *display) {
    (void)display;
    return true;
}

#endif
