/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "export.h"

#include <bytes.h>
#include <errno.h>
#include <form.h>
#include <inttypes.h>
#include <limits.h>
#include <mcap.h>
#include <program.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define COLUMN_ELEMENTS_MAX 64 /* arrays with more are one column: their size and CRC32 */

/* ---- Columns ---- */

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

int export_run(const char *path, const char *folder) {
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
