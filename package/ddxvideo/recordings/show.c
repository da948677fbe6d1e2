/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "show.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "free_space.h"

#define NS INT64_C(1000000000)

unsigned show_count(const struct folder *folder, unsigned first) {
    unsigned end = first + 1;

    while (end < folder->count && folder->file[first].session && folder->file[first].id && folder->file[end].id &&
           folder->file[end].session == folder->file[first].session)
        end++;
    return end - first;
}

void show_name(const struct found *found, char name[NAME_MAX + 1]) {
    if (found->session)
        snprintf(name, NAME_MAX + 1, "%s-%06u", found->item, (unsigned)found->session);
    else
        snprintf(name, NAME_MAX + 1, "%s", found->name);
}

static void utc(int64_t wall, char text[32]) {
    time_t seconds = (time_t)(wall / NS);
    struct tm fields;

    if (!wall || !strftime(text, 32, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&seconds, &fields)))
        strcpy(text, "-");
}

/* The sums over all files of a recording. */
static struct found sum_up(const struct found *file, unsigned count) {
    struct found sum = file[0];

    for (unsigned i = 1; i < count; i++) {
        sum.frames += file[i].frames;
        sum.bytes += file[i].bytes;
        sum.duration += file[i].duration;
        sum.lost_store += file[i].lost_store;
        sum.lost_ring += file[i].lost_ring;
        if (file[i].state > sum.state)
            sum.state = file[i].state;
    }
    return sum;
}

static void quoted(const char *text) {
    putchar('"');
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;

        if (c == '"' || c == '\\')
            printf("\\%c", c);
        else if (c < 0x20 || c == 0x7f)
            printf("\\u%04x", c);
        else
            putchar(c);
    }
    putchar('"');
}

static void show_json(const struct found *file, unsigned count, const struct found *sum, const char *name,
                      const char *begin) {
    printf("{\"recording\":");
    quoted(name);
    printf(",\"item\":");
    quoted(sum->item);
    printf(",\"utc\":");
    if (*begin == '-')
        printf("null");
    else
        quoted(begin);
    printf(",\"frames\":%" PRIu64 ",\"seconds\":%" PRId64 ".%03d,\"bytes\":%" PRIu64 ",\"state\":\"%s\"", sum->frames,
           sum->duration / NS, (int)(sum->duration % NS / 1000000), sum->bytes, found_state_name(sum->state));
    if (sum->id)
        printf(",\"lost\":{\"store\":%" PRIu64 ",\"ring\":%" PRIu64 "}", sum->lost_store, sum->lost_ring);
    else
        printf(",\"lost\":null");
    printf(",\"files\":[");
    for (unsigned i = 0; i < count; i++) {
        if (i)
            putchar(',');
        quoted(file[i].name);
    }
    puts("]}");
}

static void show_line(unsigned count, const struct found *sum, const char *name, const char *begin) {
    char lost[64] = "?";

    if (sum->id)
        snprintf(lost, sizeof lost, "%" PRIu64, sum->lost_store + sum->lost_ring);
    printf("%-20s %-20s %5u %8" PRIu64 " %9" PRId64 ".%d %8" PRIu64 " %6s  %s\n", name, begin, count, sum->frames,
           sum->duration / NS, (int)(sum->duration % NS / (NS / 10)), (sum->bytes + (1 << 20) - 1) >> 20, lost,
           found_state_name(sum->state));
}

/* The remaining time is at the rate of the running recordings so far. */
void show_room(const struct folder *folder, const char *path) {
    struct free_space room;
    uint64_t rate = 0;

    for (unsigned i = 0; i < folder->count; i++)
        if (folder->file[i].state == FOUND_RECORDING && folder->file[i].duration)
            rate += (uint64_t)((double)folder->file[i].bytes * 1e9 / (double)folder->file[i].duration);
    if (free_space_look(path, &room))
        return;
    printf("room for %" PRIu64 " MB of recordings", room.usable >> 20);
    if (rate)
        printf(", %" PRIu64 " min at this rate", room.usable / rate / 60);
    printf("; %" PRIu64 " MB of it in prepared files, %" PRIu64 " MB free", room.prepared >> 20,
           room.free >> 20);
    if (folder->pool >= 0)
        printf("; files ready: %" PRIu32, room.ready);
    putchar('\n');
}

void show_recordings(const struct folder *folder, bool json) {
    char name[NAME_MAX + 1], begin[32];

    if (!json)
        printf("%-20s %-20s %5s %8s %11s %8s %6s  %s\n", "RECORDING", "BEGIN (UTC)", "FILES", "FRAMES", "SECONDS", "MB",
               "LOST", "STATE");
    for (unsigned i = 0, count; i < folder->count; i += count) {
        const struct found *file = &folder->file[i];

        count = show_count(folder, i);
        const struct found sum = sum_up(file, count);
        show_name(file, name);
        utc(file->wall, begin);
        if (json) {
            show_json(file, count, &sum, name, begin);
        } else {
            found_clean(name);
            show_line(count, &sum, name, begin);
        }
    }
}
