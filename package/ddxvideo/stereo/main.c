/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoSVS: range from a stereo pair. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "ranger.h"

#define MS INT64_C(1000000)
#define WAIT 0.1 /* s; a signal does not end a wait, so waits are short */

static const char *const reasons[] = {"late", "pair", "picture", "store", NULL};

struct svs {
    struct program program;
    struct source source;
    struct ranger ranger;
    DDX_STORE_ID *id;
    bool failed;
};

static void fail(struct svs *svs, const char *item, int error) {
    say("%s: %s", item, ddx_error_text(error));
    svs->failed = true;
}

/* Both eyes must have the same size; of a series of pairs that differ, the first is reported. */
static bool fits(struct svs *svs) {
    const struct source *source = &svs->source;
    const struct ddxvideo_geometry *left = &source->item[LEFT].picture.geometry;
    const struct ddxvideo_geometry *right = &source->item[RIGHT].picture.geometry;

    if (source->items == 1 && left->fields == 2)
        return true;
    if (source->items == 2 && left->width == right->width && left->height == right->height)
        return true;
    if (!svs->ranger.refused && source->items == 1)
        say("%s: has %d fields, not the two of a stereo pair", source->name[0], left->fields);
    else if (!svs->ranger.refused)
        say("%s has pictures of %dx%d, %s has %dx%d: both must have the same size", source->name[0], left->width,
            left->height, source->name[1], right->width, right->height);
    svs->ranger.refused = true;
    return false;
}

static void handle(struct svs *svs, const struct pair *pair) {
    DDX_STATS_BOOK *book = svs->source.book;
    int error = fits(svs) ? ranger_run(&svs->ranger, svs->id, pair) : -EINVAL;

    if (!error)
        ddx_stats_out(book, pair->frames, ddx_time_now() - pair->written);
    else
        ddx_stats_lost(book, error == -EINVAL ? LOST_PICTURE : LOST_STORE, pair->frames);
    if (error && error != -EINVAL && error != -ENOBUFS)
        fail(svs, svs->ranger.name, error);
}

static void take(struct svs *svs, double wait) {
    struct pair pair;
    const char *at;
    int error = source_take(&svs->source, wait, &pair, &at);

    if (!error) {
        handle(svs, &pair);
        source_give(&svs->source);
    } else if (error != -EAGAIN) {
        fail(svs, at, error);
    }
    ddx_stats_write(svs->source.book);
}

static int run(struct svs *svs) {
    svs->source.book = program_book(&svs->program, reasons);
    svs->id = program_connect(&svs->program);
    const char *single = svs->source.name[1] ? NULL : svs->source.name[0];
    if (svs->id && program_attach(&svs->program, svs->source.book, svs->id, single) &&
        source_open(&svs->source, svs->id)) {
        for (; !program_stopping() && !svs->failed; program_tick(svs->source.book))
            take(svs, WAIT);
        if (!svs->failed)
            take(svs, 0); /* frames that were written before the stop */
    } else if (svs->id && !program_stopping()) {
        svs->failed = true;
    }
    source_end(&svs->source);
    program_report(svs->source.book);
    if (svs->failed)
        ddx_stats_fail(svs->source.book);
    ddx_stats_close(svs->source.book);
    ranger_close(&svs->ranger);
    source_close(&svs->source);
    ddx_store_close(svs->id);
    return svs->failed ? EXIT_FAILED : EXIT_OK;
}

/* The options as text. */
struct words {
    const char *from, *left, *right, *top;
    long disparities, window;
};

/* Exits after a line if they are wrong. */
static void understand(struct svs *svs, const struct words *words) {
    char error[CALIBRATION_ERROR_MAX];

    if (words->from && (words->left || words->right))
        program_bad_usage("-from is one item with both eyes, -left and -right are two: give one or the other");
    if (!words->left != !words->right)
        program_bad_usage("-left and -right go together");
    svs->source.name[0] = words->left ? words->left : words->from ? words->from : "video";
    svs->source.name[1] = words->right;
    if (words->right && !strcmp(words->left, words->right))
        program_bad_usage("-left and -right are the same item");
    svs->source.top = strcmp(words->top, "left") ? RIGHT : LEFT;
    if (svs->source.top == RIGHT && strcmp(words->top, "right") != 0)
        program_bad_usage("-top %s: left or right is needed", words->top);
    if (words->disparities % 16)
        program_bad_usage("-disparities %ld: a multiple of 16 is needed, from 16 to 256", words->disparities);
    if (!svs->ranger.calibration_path)
        program_bad_usage("-calib is missing");
    if (!calibration_read(&svs->ranger.calibration, svs->ranger.calibration_path, error)) {
        say("%s", error);
        exit(EXIT_USAGE);
    }
    svs->ranger.settings = (struct matcher_settings){
        .disparities = (int)words->disparities, .uniqueness = 5, .agreement = 1, .speckle = 50};
    svs->source.window = words->window * MS;
}

int main(int argc, char **argv) {
    static struct svs svs = {.ranger = {.name = "range"}};
    struct words words = {.top = "left", .disparities = 64};
    const struct option_entry options[] = {
        {"from", "ITEM", "video item with two stacked fields, one of each eye (default: video)", OPTION_NAME,
         &words.from, 0, 0},
        {"left", "ITEM", "the left camera's video item, instead of -from", OPTION_NAME, &words.left, 0, 0},
        {"right", "ITEM", "the right camera's video item", OPTION_NAME, &words.right, 0, 0},
        {"calib", "FILE", "calibration in OpenCV's YAML, as ddxvideocalib writes it", OPTION_TEXT,
         &svs.ranger.calibration_path, 0, 0},
        {"name", "ITEM", "the video item to write (default: range)", OPTION_NAME, &svs.ranger.name, 0,
         DDX_NAME_MAX - (long)sizeof ".disparity" + 1},
        {"disparities", "N", "number of disparities, 0 to N - 1 pixels, a multiple of 16 (default: 64)", OPTION_NUMBER,
         &words.disparities, 16, 256},
        {"top", "left|right", "which eye the upper field of -from is (default: left)", OPTION_TEXT, &words.top, 0, 0},
        {"window", "MS", "maximum difference of times in a pair (default: half a frame period)", OPTION_NUMBER,
         &words.window, 1, 10000},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    svs.program = (struct program){
        .name = "ddxvideoSVS",
        .purpose = "Range from a stereo pair. Writes a video item of three fields (the right picture, the range\n"
                   "picture, in which near is bright and 0 is unknown, and the left picture, both rectified), item\n"
                   "`<name>.disparity` (GREY16, 1/16 pixel, 0 is unknown) and item `<name>.stereo`:\n"
                   "distance = f * T / disparity. The newest pair is taken; a pair that comes while another one is\n"
                   "matched is lost if a newer one comes first.",
        .notes = "Frame number and time are the pair's; of two items, the left one's. Counters of the input's frames:\n"
                 "lost.late = a newer frame came first, lost.pair = the other camera has no frame of that time,\n"
                 "lost.picture = does not fit the calibration or the other camera, lost.store = could not be written\n"
                 "into the store.",
        .options = options,
    };
    program_start(&svs.program, argc, argv);
    understand(&svs, &words);
    return svs.program.check ? EXIT_OK : run(&svs);
}
