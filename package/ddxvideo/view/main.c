/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoview: an item, a stream or a file, frame by frame. */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>

#include "network.h"
#include "program.h"
#include "surface.h"
#include "view.h"

#define REFRESH (250 * VIEW_MS) /* between updates of ages and counts while no picture comes */
#define LOOK 100                /* ms, between checks for a stop */

static bool has_size(struct surface *surface, int width, int height) {
    int is_width, is_height;

    surface_size(surface, &is_width, &is_height);
    return is_width == width && is_height == height;
}

/* Gives the window the first picture's size. Until then it has the size of CIF, or the user's choice. */
static void open_window(struct view *view, bool *open) {
    const struct ddxvideo_geometry cif = {.width = 352, .height = 288, .fields = 1};
    int width, height, former_width, former_height;

    if (view->sized || (*open && !view->shot))
        return;
    view->sized = view->shot;
    picture_size(&cif, &former_width, &former_height);
    if (*open && !has_size(view->surface, former_width, former_height))
        return;
    picture_size(view->shot ? &view->shot->picture.geometry : &cif, &width, &height);
    if (!*open)
        view_name(view);
    if (!*open || width != former_width || height != former_height)
        surface_resize(view->surface, width, height);
    view->dirty = *open = true;
}

/* Time until the display changes without an event, ms. */
static int wait_for(struct view *view) {
    struct source_state state;

    view->source->state(view->source, &state);
    if (state.working || state.preparing)
        return view->dirty ? 0 : 1;
    return control_wait(view, LOOK);
}

static void take_events(struct view *view, int timeout) {
    struct surface_event event;

    while (!view->quit && surface_event(view->surface, &event, timeout)) {
        input_handle(view, &event);
        timeout = 0;
    }
}

static void check_source(struct view *view) {
    struct source_state state;

    view->source->work(view->source);
    view->source->state(view->source, &state);
    if (state.failed) {
        view->status = EXIT_FAILED;
        view->quit = true;
    }
}

/* Run until the user quits. Returns the exit status. Closes the source. */
static int view_run(struct view *view) {
    bool open = false;
    int64_t opened = ddx_time_now() + REFRESH; /* if the first picture comes soon, the window appears with its size */

    while (!view->quit && !program_stopping()) {
        check_source(view);
        control_advance(view);
        if (view->shot || ddx_time_now() > opened)
            open_window(view, &open);
        if (ddx_time_now() - view->drawn > REFRESH)
            view->dirty = true;
        if (open && view->dirty && !view->quit && !picture_draw(view)) {
            view->status = EXIT_FAILED;
            break;
        }
        take_events(view, wait_for(view));
    }
    shot_drop(view->shot);
    view->source->close(view->source);
    paint_close(&view->painter);
    return view->status;
}

#define MEMORY (UINT64_C(256) << 20)
#define MEMORY_LEAST (UINT64_C(1) << 20)

struct options {
    struct program program;
    const char *name, *memory;
    long history;
    struct source_stream stream;
};

/* A number of bytes with K, M or G after it. */
static bool parse_memory(const char *text, uint64_t *bytes) {
    static const struct {
        char letter;
        unsigned shift;
    } units[] = {{0, 0}, {'K', 10}, {'M', 20}, {'G', 30}};
    char *end;

    errno = 0;
    unsigned long long number = strtoull(text, &end, 10);
    if (errno || *text < '0' || *text > '9' || (*end && end[1]))
        return false;
    for (size_t i = 0; i < sizeof units / sizeof *units; i++)
        if (units[i].letter == *end && number <= UINT64_MAX >> units[i].shift) {
            *bytes = (uint64_t)number << units[i].shift;
            return *bytes >= MEMORY_LEAST;
        }
    return false;
}

/* A window if there is a display, otherwise the screen of this machine, with the keys of the terminal. */
static struct surface *open_surface(const char *title) {
    const char *wrong;
    bool display = getenv("DISPLAY") || getenv("WAYLAND_DISPLAY") || getenv("SDL_VIDEODRIVER");
    struct surface *surface =
        display ? window_open(title, &wrong) : screen_open(&(struct screen_choice){.keys = true}, &wrong);

    if (!surface)
        say("no display: %s%s", display ? "" : "neither DISPLAY nor WAYLAND_DISPLAY is set; ", wrong);
    return surface;
}

/* NULL: *status is the exit status. With `check`, only the settings are checked. */
static struct source *open_source(const struct options *options, bool check, const struct source_limits *limits,
                                  struct surface *surface, int *status) {
    struct source *source = NULL;

    *status = EXIT_OK;
    if (options->stream.port)
        source = source_stream(&options->stream, check, limits, surface, status);
    else if (!check && options->program.argument)
        source = source_file(options->program.argument, limits->bytes, status);
    else if (!check && !(source = source_item(options->name, (int)options->program.port, limits, surface)))
        *status = EXIT_FAILED;
    return source;
}

static int run(const struct options *options, const struct source_limits *limits) {
    struct surface *surface = open_surface(options->program.instance);
    int status = EXIT_FAILED;

    if (!surface)
        return status;
    struct view view = {.surface = surface,
                        .items = !options->stream.port && !options->program.argument,
                        .store = (int)options->program.port,
                        .limits = *limits,
                        .position = -1,
                        .wanted = -1,
                        .field = LAYOUT_ALL,
                        .zoom = {1, 0, 0}};
    view.source = open_source(options, false, limits, surface, &status);
    if (view.source)
        status = view_run(&view);
    surface_close(surface);
    return status;
}

static int judge(struct options *options, struct source_limits *limits) {
    int status;

    limits->frames = (unsigned)options->history;
    limits->bytes = MEMORY;
    if (options->memory && !parse_memory(options->memory, &limits->bytes))
        program_bad_usage("-memory %s: a size of at least 1M is needed, as 64M or 1G", options->memory);
    if (!!options->name + !!options->stream.port + !!options->program.argument > 1)
        program_bad_usage("one of -name, -port and FILE is needed, not several");
    if (!options->name)
        options->name = "video";
    options->stream.instance = options->program.instance;
    options->stream.store = (int)options->program.port;
    open_source(options, true, limits, NULL, &status);
    return status;
}

int main(int argc, char **argv) {
    static struct options options = {.history = 250, .stream = {.group = NETWORK_GROUP}};
    const struct option_entry table[] = {
        {"name", "ITEM", "the video item (default: video)", OPTION_NAME, &options.name, 0, 0},
        {"port", "PORT", "the stream that comes to this even port, instead of an item", OPTION_NUMBER,
         &options.stream.port, 2, 65532},
        {"group", "ADDRESS", "multicast group of the stream (default: " NETWORK_GROUP "), or none", OPTION_TEXT,
         &options.stream.group, 0, 0},
        {"interface", "NAME", "network interface for the group (default: by the routing table)", OPTION_TEXT,
         &options.stream.interface, 0, 0},
        {"key", "FILE", "the key of an encrypted stream", OPTION_TEXT, &options.stream.key, 0, 0},
        {"history", "N", "frames to go back in an item or a stream (default: 250)", OPTION_NUMBER, &options.history, 1,
         1000000},
        {"memory", "SIZE", "what these, or decoded frames of an MP4 file, take at most: 64M, 1G (default: 256M)",
         OPTION_TEXT, &options.memory, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    struct source_limits limits;

    options.program = (struct program){
        .name = "ddxvideoview",
        .positional = "FILE",
        .optional = true,
        .purpose = "Shows a video item, a stream or a file in a window, frame by frame; without a display, on the\n"
                   "screen of this machine. FILE is a recording, Y4M or MP4; all its files are shown. While it is\n"
                   "paused, an item or a stream goes on being received, and its last frames can be looked at.",
        .notes = "Keys are those of mpv: Space pauses, `.` and `,` step, `s` saves the frame, `q` quits; `?` lists\n"
                 "all of them.",
        .options = table,
        .brief = true,
    };
    program_start(&options.program, argc, argv);
    int status = judge(&options, &limits);
    if (status || options.program.check)
        return status;
    signal(SIGTTOU, SIG_IGN); /* a line from the background must not stop it */
    return run(&options, &limits);
}
