/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosave: records a video item of the store. */
#include <string.h>

#include "recorder.h"
#include "schedule.h"

#define QUALITY 18 /* as good as it looks: x264's crf */
#define QUALITY_LEAST 10
#define QUALITY_MOST 40
#define BITRATE_MOST 1000000

static bool ends_with(const char *text, const char *end) {
    size_t length = strlen(text), part = strlen(end);

    return length >= part && !strcmp(text + length - part, end);
}

/* Chooses Y4M or MP4; -1 for a number that was not given. */
static void choose_format(struct recorder *recorder, const char *format, long quality, long bitrate) {
    bool mp4 = ends_with(recorder->place, ".mp4"), h264 = format ? !strcmp(format, "h264") : mp4;

    if (format && !h264 && strcmp(format, "y4m"))
        program_bad_usage("-format %s: y4m or h264 is needed", format);
    if (format && mp4 && !h264)
        program_bad_usage("-format y4m: -output %s is the name of an MP4 file; name it .y4m", recorder->place);
    if (h264 && ends_with(recorder->place, ".y4m"))
        program_bad_usage("-format h264: -output %s is the name of a Y4M file; name it .mp4", recorder->place);
    if (!h264 && (quality >= 0 || bitrate >= 0))
        program_bad_usage("%s: Y4M has each picture as it is; it is for -format h264",
                          quality >= 0 ? "-quality" : "-bitrate");
    if (quality > 0 && quality < QUALITY_LEAST)
        program_bad_usage("-quality %ld: a whole number from %d (best) to %d is needed, or 0, lossless", quality,
                          QUALITY_LEAST, QUALITY_MOST);
    if (!quality && bitrate > 0)
        program_bad_usage("-bitrate: with -quality 0, lossless, frames take what they need; leave one out");
    recorder->coded = h264;
    recorder->h264 = (struct h264_settings){quality < 0 ? QUALITY : quality, bitrate < 0 ? 0 : bitrate};
}

int main(int argc, char **argv) {
    struct recorder recorder = {.name = "video"};
    const char *full = "stop", *start = "recording", *rate = NULL, *format = NULL;
    long pre_roll = 0, quality = -1, bitrate = -1;
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to record (default: video)", OPTION_NAME, &recorder.name, 0, 0},
        {"output", "FILE|DIR|-", "the file to write, or a folder for <name>-<number>-<UTC>.y4m or .mp4", OPTION_TEXT,
         &recorder.place, 0, 0},
        {"format", "y4m|h264", "Y4M, or H.264 in MP4 (default: what the name of -output ends in, or y4m)", OPTION_TEXT,
         &format, 0, 0},
        {"quality", "N", "of H.264: 10 (best) to 40, or 0, lossless (default: 18)", OPTION_NUMBER, &quality, 0,
         QUALITY_MOST},
        {"bitrate", "KBIT", "of H.264: at most this rate in kbit/s (default: what the quality needs)", OPTION_NUMBER,
         &bitrate, 1, BITRATE_MOST},
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
        .purpose = "Records a video item of the store as Y4M or MP4, each frame with its time; ddxvideoload plays it.\n"
                   "Begins with the first frame that is written after the start, however long that takes.",
        .notes = "`-` is standard output, for a player; the counters go to standard error then.\n"
                 "A file that exists is overwritten, unless the last recorder did not end as told: then the next free\n"
                 "one of FILE, FILE-2 ... (before the extension) is taken. In a folder nothing is overwritten, and a\n"
                 "change of the picture's size or rate begins a new file. Counters: lost.store = overwritten in\n"
                 "the store before it was read, lost.ring = the disk was too slow, lost.write = the disk failed,\n"
                 "lost.encode = the encoder failed, lost.restart = no recorder ran.",
        .options = options,
    };
    program_start(&recorder.program, argc, argv);
    if (!recorder.place)
        program_bad_usage("-output is missing");
    choose_format(&recorder, format, quality, bitrate);
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
