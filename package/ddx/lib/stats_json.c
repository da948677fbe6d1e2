/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The JSON line of a DDX_STATS. */
#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#include "ddx_stats.h"

struct line {
    char *text;
    size_t size, length; /* length includes text that did not fit */
};

__attribute__((format(printf, 2, 3))) static void put(struct line *line, const char *format, ...) {
    size_t room = line->length < line->size ? line->size - line->length : 0;

    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(room ? line->text + line->length : NULL, room, format, arguments);
    va_end(arguments);
    line->length += length > 0 ? (size_t)length : 0;
}

/* At most `limit` bytes of text, escaped: text from a store item may contain any bytes. */
static void put_string(struct line *line, const char *text, size_t limit) {
    put(line, "\"");
    for (size_t i = 0; i < limit && text[i]; i++) {
        unsigned char c = (unsigned char)text[i];

        if (c < 0x20 || c == '"' || c == '\\' || c >= 0x7f)
            put(line, "\\u%04x", c);
        else
            put(line, "%c", c);
    }
    put(line, "\"");
}

int ddx_stats_json(const DDX_STATS *stats, const char *instance, char *text, size_t size) {
    struct line line = {text, size, 0};

    put(&line, "{\"instance\":");
    put_string(&line, instance, DDX_NAME_MAX);
    put(&line, ",\"in\":%" PRIu64 ",\"out\":%" PRIu64 ",\"waiting\":%" PRIu64 ",\"skipped\":%" PRIu64 ",\"lost\":{",
        stats->in, stats->out, stats->waiting, stats->skipped);
    for (unsigned i = 0; i < stats->reasons && i < DDX_STATS_REASONS; i++) {
        put(&line, i ? "," : "");
        put_string(&line, stats->lost[i].name, sizeof(stats->lost[i].name));
        put(&line, ":%" PRIu64, stats->lost[i].frames);
    }
    put(&line, "},\"latency_us\":{\"p50\":%" PRIu64 ",\"p99\":%" PRIu64 ",\"max\":%" PRIu64 "}",
        ddx_stats_percentile(stats, 0.50), ddx_stats_percentile(stats, 0.99), stats->latency_max);
    put(&line, ",\"latency_until\":\"%s\"", stats->latency_until == DDX_STATS_DISK ? "disk" : "out");
    put(&line, ",\"starts\":%" PRIu32 ",\"first_ns\":%" PRId64 ",\"last_ns\":%" PRId64 "}", stats->starts, stats->first,
        stats->last);
    return (int)line.length;
}
