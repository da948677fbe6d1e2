/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoplay: the newest frame of a video item on the screen of this machine, without X. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "player.h"

static bool parse_field(const char *text, int *field) {
    char *end;
    long number = strtol(text, &end, 10);

    *field = strcmp(text, "all") ? (int)number - 1 : LAYOUT_ALL;
    return *field == LAYOUT_ALL ? !strcmp(text, "all")
                                : *text != ' ' && end != text && !*end && number >= 1 && number <= DDX_VIDEO_FIELDS;
}

/* The number of a word in a list that ends with NULL. False: none of them. */
static bool parse_word(const char *text, const char *const *words, int *number) {
    for (*number = 0; words[*number]; ++*number)
        if (!strcmp(text, words[*number]))
            return true;
    return false;
}

static bool parse_mode(const char *text, int *width, int *height) {
    int used = 0;

    return sscanf(text, "%5dx%5d%n", width, height, &used) == 2 && !text[used] && *width > 0 && *height > 0;
}

int main(int argc, char **argv) {
    static struct player player = {.name = "video"};
    static const char *const fits[] = {
        [LAYOUT_SHAPE] = "shape", [LAYOUT_FILL] = "fill", [LAYOUT_PIXELS] = "pixels", NULL};
    static const char *const switches[] = {"off", "on", NULL};
    const char *field = "all", *fit = "shape", *mode = NULL, *text = "on";
    int fit_number, text_number;
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item (default: video)", OPTION_NAME, &player.name, 0, 0},
        {"field", "N", "one field, from 1, or all (default: all)", OPTION_TEXT, &field, 0, 0},
        {"fit", "HOW", "shape: as large as possible in its shape (default); fill: the whole screen; pixels: not scaled",
         OPTION_TEXT, &fit, 0, 0},
        {"output", "CONNECTOR", "such as HDMI-A-1 (default: the first with a monitor)", OPTION_TEXT,
         &player.monitor.choice.output, 0, 0},
        {"mode", "WxH", "the screen's size (default: what the monitor prefers)", OPTION_TEXT, &mode, 0, 0},
        {"text", "on|off", "item, frame, rate, age and losses below the picture (default: on)", OPTION_TEXT, &text, 0,
         0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    player.program = (struct program){
        .name = "ddxvideoplay",
        .purpose = "Shows the newest frame of a video item on the screen of this machine, without X. Frames that come\n"
                   "faster than the screen shows them are counted as `skipped`.",
        .notes = "While frames are missing, the last picture stays, in grey, with what is missing and since when. A\n"
                 "screen that is not there, or in use, is tried again twice a second. The text console is back when\n"
                 "the program ends.",
        .options = options,
    };
    program_start(&player.program, argc, argv);
    if (!parse_field(field, &player.field))
        program_bad_usage("-field %s: all, or a number from 1 to 16, is needed", field);
    if (!parse_word(fit, fits, &fit_number))
        program_bad_usage("-fit %s: shape, fill or pixels is needed", fit);
    if (!parse_word(text, switches, &text_number))
        program_bad_usage("-text %s: on or off is needed", text);
    if (mode && !parse_mode(mode, &player.monitor.choice.width, &player.monitor.choice.height))
        program_bad_usage("-mode %s: a size such as 1024x768 is needed", mode);
    player.fit = (enum layout_fit)fit_number;
    player.text = text_number;
    return player.program.check ? EXIT_OK : player_run(&player);
}
