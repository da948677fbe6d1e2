/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosave: records a video item of the store. */
#include <string.h>

#include "recorder.h"
#include "schedule.h"

int main(int argc, char **argv) {
    struct recorder recorder = {.name = "video"};
    const char *full = "stop", *start = "recording", *rate = NULL;
    long pre_roll = 0;
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to record (default: video)", OPTION_NAME, &recorder.name, 0, 0},
        {"output", "FILE|DIR|-", "the Y4M file to write, or a folder for <name>-<number>-<UTC>.y4m", OPTION_TEXT,
         &recorder.place, 0, 0},
        {"ring", "FRAMES", "frames between store and disk (default: 2.5 s, at least 64)", OPTION_NUMBER,
         &recorder.queue_frames, 2, 100000},
        {"keep", "FRAMES", "in the store for a recorder that comes late (default: 8, and of small pictures 25)",
         OPTION_NUMBER, &recorder.keep_frames, 1, 128},
        {"segment", "MB", "record into prepared files of this size, with an index; 0: into one that grows",
         OPTION_NUMBER, &recorder.segment, 0, 65536},
        {"skip", "N", "record one of N frames (default: 1, each)", OPTION_NUMBER, &recorder.decimate.skip, 1, 100000},
        {"rate", "R", "record at most R frames a second, evenly, of an item that says how many it has", OPTION_TEXT,
         &rate, 0, 0},
        {"recover", NULL, "with -segment: finish unfinished recordings and exit", OPTION_FLAG, &recorder.recover, 0, 0},
        {"full", "stop|recycle", "with -segment, on a full disk: record no more (default), or give up the oldest",
         OPTION_TEXT, &full, 0, 0},
        {"start", "recording|paused", "begin at once (default), or when `ddxctl record start` says so", OPTION_TEXT,
         &start, 0, 0},
        {"pre-roll", "SECONDS", "while it is paused, keep so much in memory, to be recorded first (default: 0)",
         OPTION_NUMBER, &pre_roll, 0, PRE_ROLL_MAX},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    recorder.program = (struct program){
        .name = "ddxvideosave",
        .purpose = "Records a video item of the store as Y4M, each frame with its time; ddxvideoload plays it back.\n"
                   "Begins with the first frame that is written after the start, however long that takes.",
        .notes = "`-` is standard output, for a player; the counters go to standard error then.\n"
                 "A file that exists is overwritten, unless the last recorder did not end as told: then the next free\n"
                 "one of FILE, FILE-2 ... (before the extension) is taken. In a folder nothing is overwritten, and a\n"
                 "change of the picture's size or rate begins a new file. Counters: lost.store = overwritten in\n"
                 "the store before it was read, lost.ring = the disk was too slow, lost.write = the disk failed,\n"
                 "lost.restart = no recorder ran.",
        .options = options,
    };
    program_start(&recorder.program, argc, argv);
    if (!recorder.place)
        program_bad_usage("-output is missing");
    recorder.recycle = !strcmp(full, "recycle");
    if (!recorder.recycle && strcmp(full, "stop"))
        program_bad_usage("-full %s: stop or recycle is needed", full);
    recorder.preroll.seconds = pre_roll;
    recorder.paused = !strcmp(start, "paused");
    if (!recorder.paused && strcmp(start, "recording"))
        program_bad_usage("-start %s: recording or paused is needed", start);
    struct schedule_speed speed = {0, 1};
    if (rate && (!schedule_parse_speed(rate, &speed) || !speed.num))
        program_bad_usage("-rate %s: a number above 0, up to 1000, is needed", rate);
    if (rate && recorder.decimate.skip > 1)
        program_bad_usage("-skip and -rate: one of them is enough");
    recorder.decimate.rate_num = speed.num;
    recorder.decimate.rate_den = speed.den;
    if (recorder.recover && !recorder.segment)
        program_bad_usage("-recover: -segment is needed");
    return recorder.program.check ? EXIT_OK : recorder_run(&recorder);
}
