/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosave: records a video item of the store. */
#include "recorder.h"

int main(int argc, char **argv) {
    struct recorder recorder = {.name = "video"};
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to record (default: video)", OPTION_TEXT, &recorder.name, 0, 0},
        {"output", "FILE|DIR", "the Y4M file to write, or a folder for <name>-<number>-<UTC>.y4m", OPTION_TEXT,
         &recorder.place, 0, 0},
        {"ring", "FRAMES", "frames between store and disk (default: 2.5 s, at least 64)", OPTION_NUMBER,
         &recorder.ring_frames, 2, 100000},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    recorder.program = (struct program){
        .name = "ddxvideosave",
        .purpose = "Records a video item of the store as Y4M, each frame with its time; ddxvideoload plays it back.\n"
                   "Begins with the first frame that is written after the start, however long that takes.",
        .notes = "A file that exists is overwritten; in a folder nothing is, and a change of the picture's size or\n"
                 "rate begins a new file. Counters: lost.store = overwritten in the store before it was read,\n"
                 "lost.ring = the disk was too slow, lost.write = the disk failed, lost.restart = no recorder ran.",
        .options = options,
    };
    program_start(&recorder.program, argc, argv);
    if (!recorder.place) {
        say("-output is missing; see ddxvideosave -help");
        return EXIT_USAGE;
    }
    return recorder_run(&recorder);
}
