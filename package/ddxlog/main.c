/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxlog: logs items of the store, replays them. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_time.h"
#include "export.h"
#include "logger.h"
#include "recover.h"
#include "replay.h"

struct words {
    const char *config, *replay, *recover, *export, *prefix, *except, *rate, *from, *to, *clock, *tick;
    bool loop, step;
    long readers;
};

static const char purpose[] =
    "Logs items of the store as MCAP, configured by logger.conf (docs/logging.md), or one of:\n"
    "  -replay FILE          writes a log's values back into the store, each when it is due\n"
    "  -export FOLDER FILE   writes tables: one CSV file for each item\n"
    "  -recover FILE         repairs a truncated file; the next start of ddxlog does so, too";
static const char notes[] =
    "Times in the file are wall time; its metadata `ddxlog` has wall_offset_ns, wall time less CLOCK_MONOTONIC.\n"
    "Counters: lost.store = overwritten in the store before it was read, lost.queue = the disk was too slow,\n"
    "lost.write = the disk failed, lost.restart = waiting when the program died; skipped = left out by rate=.";

/* "-2.5" as ns; false if the text is not a number of seconds. */
static bool parse_seconds(const char *text, int64_t *ns) {
    char *end;
    double seconds = strtod(text, &end);

    if (end == text || *end || !isfinite(seconds) || fabs(seconds) > 1e9)
        return false;
    *ns = (int64_t)(seconds * SECOND);
    return true;
}

static int bad(const char *option, const char *value, const char *allowed) {
    say("-%s %s: %s; see ddxlog -help", option, value, allowed);
    return EXIT_USAGE;
}

static int run_replay(const struct program *program, const struct words *words) {
    struct replay replay = {.program = *program,
                            .path = words->replay,
                            .prefix = words->prefix ? words->prefix : "",
                            .except = words->except,
                            .clock = words->clock,
                            .tick = words->tick,
                            .loop = words->loop,
                            .step = words->step || words->tick,
                            .readers = words->readers,
                            .to = INT64_MAX};

    if (!strcmp(program->instance, program->name))
        replay.program.instance = "ddxlog.replay"; /* beside the logger */
    if (!schedule_parse_speed(words->rate, &replay.speed))
        return bad("rate", words->rate, "a number from 0 to 1000 is needed");
    if (words->from && !parse_seconds(words->from, &replay.from))
        return bad("from", words->from, "seconds from the first value are needed");
    if (words->to && (!parse_seconds(words->to, &replay.to) || replay.to < 0 || replay.to < replay.from))
        return bad("to", words->to, "seconds from the first value are needed, not less than -from");
    if (replay.clock && (!replay.speed.num || replay.step))
        return bad("clock", words->clock, "needs time that passes: not with -rate 0, -step or -tick");
    return program->check ? EXIT_OK : replay_run(&replay);
}

static int run_recover(const struct program *program, const char *path) {
    static const atomic_bool never = false;
    struct recovery recovery;
    char error[MCAP_ERROR_MAX];

    if (program->check)
        return EXIT_OK;
    int result = recover(path, &never, &recovery, error);
    if (result == -EALREADY)
        say("%s: is complete, nothing to do", path);
    else if (result == -EBUSY)
        say("%s: is being written now; stop its ddxlog first", path);
    else if (result)
        say("%s: %s", path, error);
    else
        say("%s: %llu messages, %llu bytes left over%s", path, (unsigned long long)recovery.messages,
            (unsigned long long)recovery.state.left_over,
            recovery.kept ? "; chunks in the middle are damaged or left out, so the old file is kept as .damaged" : "");
    if (!result && mcap_refused_text(&recovery.state, error))
        say("%s: %s", path, error);
    return !result || result == -EALREADY ? EXIT_OK : result == -EBADMSG ? EXIT_USAGE : EXIT_FAILED;
}

static int run_logger(const struct program *program, const struct words *words) {
    struct logger *logger = calloc(1, sizeof *logger);
    char error[CONFIG_ERROR_MAX];

    if (!logger)
        return EXIT_FAILED;
    logger->program = *program;
    int status = EXIT_USAGE;
    if (config_read(words->config, &logger->config, error))
        say("%s", error);
    else
        status = program->check ? EXIT_OK : logger_run(logger);
    config_free(&logger->config);
    free(logger);
    return status;
}

int main(int argc, char **argv) {
    struct words words = {.rate = "1"};
    const struct option_entry options[] = {
        {"c", "FILE", "log according to this configuration", OPTION_TEXT, &words.config, 0, 0},
        {"replay", "FILE", "replay this log", OPTION_TEXT, &words.replay, 0, 0},
        {"prefix", "TEXT", "replay: before the items' names", OPTION_TEXT, &words.prefix, 0, 0},
        {"except", "PATTERNS", "replay: not these items, such as video*,rear*", OPTION_TEXT, &words.except, 0, 0},
        {"rate", "X", "replay: X times as fast (default: 1); 0: without waiting, with -readers as they read",
         OPTION_TEXT, &words.rate, 0, 0},
        {"loop", NULL, "replay: repeat without end", OPTION_FLAG, &words.loop, 0, 0},
        {"from", "S", "replay: from this second on; negative: wait that long first", OPTION_TEXT, &words.from, 0, 0},
        {"to", "S", "replay: up to this second", OPTION_TEXT, &words.to, 0, 0},
        {"step", NULL, "replay: a value for each line on standard input", OPTION_FLAG, &words.step, 0, 0},
        {"tick", "ITEM", "replay: -step, each up to the next value of this item", OPTION_TEXT, &words.tick, 0, 0},
        {"readers", "N", "replay: wait for N readers of each item", OPTION_NUMBER, &words.readers, 0, 1000},
        {"clock", "ITEM", "replay: an item with the start time, for ddxvideoload -clock", OPTION_TEXT, &words.clock, 0,
         0},
        {"export", "FOLDER", "write tables to this folder", OPTION_TEXT, &words.export, 0, 0},
        {"recover", "FILE", "repair this truncated file", OPTION_TEXT, &words.recover, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    struct program program = {.name = "ddxlog", .purpose = purpose, .notes = notes, .options = options};

    for (int i = 1; i < argc; i++) /* only -export has a further argument */
        if (!strncmp(argv[i], "-export", 7) || !strncmp(argv[i], "--export", 8))
            program.positional = "FILE";
    program_start(&program, argc, argv);
    if (!words.config + !words.replay + !words.export + !words.recover != 3) {
        say("one of -c, -replay, -export and -recover is needed; see ddxlog -help");
        return EXIT_USAGE;
    }
    if (words.replay)
        return run_replay(&program, &words);
    if (words.recover)
        return run_recover(&program, words.recover);
    if (words.export)
        return program.check ? EXIT_OK : export_run(program.argument, words.export);
    return run_logger(&program, &words);
}
