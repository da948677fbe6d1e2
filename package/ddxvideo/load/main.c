/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideoload: plays a Y4M file into the store. */
#include <string.h>

#include "player.h"
#include "video_layout.h"

int main(int argc, char **argv) {
    struct player player = {.name = "video"};
    const char *rate = "1", *layout_name = "YUV420P";
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to write (default: video)", OPTION_NAME, &player.name, 0,
         DDX_NAME_MAX - (long)sizeof ".parameters" + 1},
        {"loop", NULL, "play it again and again; times and frame numbers go on", OPTION_FLAG, &player.loop, 0, 0},
        {"rate", "X", "play X times as fast (default: 1); 0: as fast as possible, with -readers as they read",
         OPTION_TEXT, &rate, 0, 0},
        {"readers", "N", "wait for N readers of the item before the first frame", OPTION_NUMBER, &player.readers, 0,
         1000},
        {"layout", "LAYOUT", "pictures in " VIDEO_LAYOUT_NAMES " (default: YUV420P)", OPTION_TEXT,
         &layout_name, 0, 0},
        {"clock", "ITEM", "begin with the replay of `ddxlog -replay FILE -clock ITEM`",
         OPTION_TEXT, &player.clock, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    player.program = (struct program){
        .name = "ddxvideoload",
        .positional = "FILE",
        .purpose = "Plays a Y4M file into the store, as a video item; its frame numbers go into item `<name>.frame`,\n"
                   "its settings into `<name>.parameters`.\n"
                   "Each frame is written when it is due: by the times that ddxvideosave recorded, or else by the\n"
                   "frame rate in the file. A late frame is written late, at most two in the time of one; none is\n"
                   "left out. Pictures in another layout are converted.",
        .notes = "The time of a frame in the item is its due time: the time of the first frame plus its recorded\n"
                 "time (divided by X; with -rate 0 as recorded). FILE may be a pipe, and `-` is standard\n"
                 "input: ffmpeg ... | ddxvideoload -. A file that ends within a frame is played up to there; a line\n"
                 "says so.",
        .options = options,
    };
    program_start(&player.program, argc, argv);
    if (!schedule_parse_speed(rate, &player.speed))
        program_bad_usage("-rate %s: a number from 0 to 1000 is needed", rate);
    if (player.clock && (player.loop || strcmp(rate, "1") != 0))
        program_bad_usage("-clock sets the rate and plays once: not with -rate or -loop");
    const struct video_layout *layout = video_layout_named(layout_name);
    if (!layout)
        program_bad_usage("-layout %s: " VIDEO_LAYOUT_NAMES " is needed", layout_name);
    player.format = layout->format;
    return player.program.check ? EXIT_OK : player_run(&player);
}
