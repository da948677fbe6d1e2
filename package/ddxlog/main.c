/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxlog: logs items of the store, replays them. */
#include <bytes.h>
#include <errno.h>
#include <form.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <mcap.h>
#include <program.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "ddx_time.h"
#include "logger.h"
#include "recover.h"
#include "replay.h"

/* ---- A log as tables, one CSV file for each item: columns ---- */

#define COLUMN_ELEMENTS_MAX 64 /* arrays with more are one column: their size and CRC32 */

/* The columns of a field: one for a number, one for each element of an array, one for a text or a large array. */

/* Arrays of char are texts. */
static bool is_text(const struct form_leaf *leaf) {
    return leaf->kind == DDX_KIND_CHAR && leaf->count > 1;
}

static bool is_large(const struct form_leaf *leaf) {
    return leaf->count > COLUMN_ELEMENTS_MAX && !is_text(leaf);
}

/* Write the names, or the values, each after a comma. */
static void column_names(FILE *file, const struct form_leaf *leaf) {
    if (leaf->count == 1 || is_text(leaf) || is_large(leaf)) {
        fprintf(file, ",%s", leaf->name);
        return;
    }
    for (uint32_t i = 0; i < leaf->count; i++)
        fprintf(file, ",%s[%u]", leaf->name, (unsigned)i);
}

static void write_number(FILE *file, const struct form_leaf *leaf, const unsigned char *at) {
    struct cursor cursor = {at, at + leaf->bytes, false};
    uint64_t number = cursor_number(&cursor, leaf->bytes);
    unsigned unused = 64 - 8 * leaf->bytes;

    if (leaf->kind == DDX_KIND_FLOAT && leaf->bytes == 4) {
        uint32_t bits = (uint32_t)number;
        float value;

        memcpy(&value, &bits, sizeof value);
        fprintf(file, "%.9g", (double)value); /* enough digits to read the same number again */
    } else if (leaf->kind == DDX_KIND_FLOAT) {
        double value;

        memcpy(&value, &number, sizeof value);
        fprintf(file, "%.17g", value);
    } else if (leaf->kind == DDX_KIND_UNSIGNED) {
        fprintf(file, "%" PRIu64, number);
    } else {
        fprintf(file, "%" PRId64, (int64_t)(number << unused) >> unused);
    }
}

/* The text up to its zero byte, in quotes; for other bytes their size and CRC32. */
static void write_text(FILE *file, const unsigned char *at, size_t size) {
    size_t length = strnlen((const char *)at, size);

    for (size_t i = 0; i < length; i++)
        if (at[i] < ' ' || at[i] == 127) {
            fprintf(file, "%zu bytes crc32=%08" PRIx32, size, crc32_of(0, at, size));
            return;
        }
    fputc('"', file);
    for (size_t i = 0; i < length; i++)
        fputs(at[i] == '"' ? "\"\"" : (char[]){(char)at[i], 0}, file);
    fputc('"', file);
}

static void column_values(FILE *file, const struct form_leaf *leaf, const unsigned char *message) {
    const unsigned char *at = message + leaf->message;
    size_t size = (size_t)leaf->bytes * leaf->count;

    if (is_text(leaf) && size <= 4096) {
        fputc(',', file);
        write_text(file, at, size);
    } else if (is_text(leaf) || is_large(leaf)) {
        fprintf(file, ",%zu bytes crc32=%08" PRIx32, size, crc32_of(0, at, size));
    } else {
        for (uint32_t i = 0; i < leaf->count; i++) {
            fputc(',', file);
            write_number(file, leaf, at + (size_t)i * leaf->bytes);
        }
    }
}

/* ---- Tables ---- */

/* The table of a channel. */
struct table {
    FILE *file;
    struct form *form;
    bool foreign; /* not written by ddxlog: left out */
};

struct exporter {
    const char *folder;
    struct mcap_reader *reader;
    int64_t wall_offset;
    struct table tables[65536];
    size_t leaves; /* of all tables; limited, since a short declaration may have many */
    uint64_t rows, odd;
};

#define LEAVES_MAX ((size_t)4 * FORM_LEAVES_MAX)

/* Create <item>.csv, or <item>.2.csv after a change of its layout; slashes in the name become underscores. */
static FILE *create(const struct exporter *exporter, const char *topic, char path[PATH_MAX]) {
    for (int number = 1; number < 1000; number++) {
        char suffix[16] = "";

        if (number > 1)
            snprintf(suffix, sizeof suffix, ".%d", number);
        int length = snprintf(path, PATH_MAX, "%s/", exporter->folder);
        if (length + (int)strlen(topic) + 24 >= PATH_MAX) {
            errno = ENAMETOOLONG;
            return NULL;
        }
        for (const char *c = topic; *c; c++)
            path[length++] = *c == '/' ? '_' : *c;
        snprintf(path + length, PATH_MAX - (size_t)length, "%s.csv", suffix);
        FILE *file = fopen(path, "wxe");
        bool mine = false;
        if (file || errno != EEXIST)
            return file;
        for (unsigned id = 0; id < 65536 && !mine; id++) { /* whether an earlier layout of the item has that name */
            const struct mcap_channel *other = mcap_channel(exporter->reader, (uint16_t)id);
            mine = exporter->tables[id].file && other && !strcmp(other->topic, topic);
        }
        if (!mine) {
            errno = EEXIST;
            return NULL;
        }
    }
    return NULL;
}

/* 0, or the exit status after a line. */
static int open_table(struct exporter *exporter, struct table *table, const struct mcap_channel *channel) {
    const char *type = channel ? mcap_value(channel, "ddx.type") : NULL;
    const char *declaration = channel ? mcap_value(channel, "ddx.declaration") : NULL;
    const char *extents = channel ? mcap_value(channel, "ddx.extents") : NULL;
    char path[PATH_MAX] = "";

    table->foreign = !type || !declaration || form_of_text(type, declaration, extents ? extents : "", &table->form);
    if (table->foreign)
        return EXIT_OK;
    if (table->form->leaf_count > LEAVES_MAX - exporter->leaves) {
        say("%s: left out: with it, the tables of this log have more than %zu columns", channel->topic, LEAVES_MAX);
        form_free(table->form);
        table->form = NULL;
        table->foreign = true;
        return EXIT_OK;
    }
    exporter->leaves += table->form->leaf_count;
    table->file = create(exporter, channel->topic, path);
    if (!table->file) {
        say("%s: %s; name a new or an empty folder", path, strerror(errno));
        return EXIT_FAILED;
    }
    fputs("wall_ns,monotonic_ns,sequence", table->file);
    for (unsigned i = 0; i < table->form->leaf_count; i++)
        column_names(table->file, &table->form->leaves[i]);
    fputc('\n', table->file);
    return EXIT_OK;
}

static void write_row(struct exporter *exporter, const struct table *table, const struct mcap_message *message) {
    int64_t monotonic = (int64_t)(message->publish_time - (uint64_t)exporter->wall_offset);

    fprintf(table->file, "%" PRIu64 ",%" PRId64 ",%" PRIu32, message->publish_time, monotonic, message->sequence);
    for (unsigned i = 0; i < table->form->leaf_count; i++)
        column_values(table->file, &table->form->leaves[i], message->data);
    fputc('\n', table->file);
    exporter->rows++;
}

static int write_tables(struct exporter *exporter, const char *path) {
    struct mcap_message message;
    int result;

    while ((result = mcap_next(exporter->reader, &message)) > 0) {
        struct table *table = &exporter->tables[message.channel];

        if (!table->file && !table->foreign) {
            int status = open_table(exporter, table, mcap_channel(exporter->reader, message.channel));

            if (status)
                return status;
        }
        if (table->foreign)
            continue;
        if (message.size == table->form->message_size)
            write_row(exporter, table, &message);
        else
            exporter->odd++;
    }
    if (result < 0) {
        say("%s: cannot be read: %s", path, strerror(-result));
        return EXIT_FAILED;
    }
    return EXIT_OK;
}

static int close_tables(struct exporter *exporter) {
    int status = EXIT_OK;

    for (unsigned id = 0; id < 65536; id++) {
        struct table *table = &exporter->tables[id];
        bool bad = table->file && (ferror(table->file) | fclose(table->file));

        if (bad && !status) {
            say("%s: cannot be written: %s", exporter->folder, strerror(errno));
            status = EXIT_FAILED;
        }
        form_free(table->form);
    }
    return status;
}

/*
 * Write <item>.csv into the folder, which is made if it does not exist; existing files are not overwritten. Returns the
 * program's exit status, after a line if it is not 0.
 */
static int export_run(const char *path, const char *folder) {
    char error[MCAP_ERROR_MAX];
    struct exporter *exporter = calloc(1, sizeof *exporter);

    if (!exporter)
        return EXIT_FAILED;
    exporter->folder = folder;
    exporter->reader = mcap_open(path, error);
    int status = EXIT_OK;
    if (!exporter->reader) {
        say("%s: %s", path, error);
        status = EXIT_USAGE;
    } else if (mkdir(folder, 0777) && errno != EEXIST) {
        say("%s: %s", folder, strerror(errno));
        status = EXIT_FAILED;
    } else {
        const char *offset = mcap_metadata(exporter->reader, "ddxlog", "wall_offset_ns");

        exporter->wall_offset = offset ? strtoll(offset, NULL, 10) : 0;
        status = write_tables(exporter, path);
        int closed = close_tables(exporter);
        struct mcap_state state = mcap_state(exporter->reader);
        status = status ? status : closed;
        if (!state.complete || state.damaged || exporter->odd)
            say("%s: %s%u of %u chunks damaged, %" PRIu64 " messages of the wrong size left out", path,
                state.complete ? "" : "was truncated; ", state.damaged, state.chunks, exporter->odd);
        if (mcap_refused_text(&state, error))
            say("%s: %s", path, error);
        if (!status)
            say("%" PRIu64 " rows written to %s", exporter->rows, folder);
    }
    mcap_close(exporter->reader);
    free(exporter);
    return status;
}

/* ---- The command line ---- */

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
