/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddxctl.h"

/* Error messages. */

int complain(const char *item, int error) {
    if (item)
        fprintf(stderr, "ddxctl: %s: %s\n", item, ddx_error_text(error));
    else
        fprintf(stderr, "ddxctl: %s\n", ddx_error_text(error));
    return 1;
}

/* Print `text` as a JSON string, with its quotes; `length` bytes or up to a NUL. */
static void json_string(const char *text, size_t length) {
    putchar('"');
    for (size_t i = 0; i < length && text[i]; i++) {
        unsigned char c = (unsigned char)text[i];

        if (c == '"' || c == '\\')
            printf("\\%c", c);
        else if (c < ' ' || c > 126) /* bytes, not characters: their encoding is unknown */
            printf("\\u%04x", c);
        else
            putchar(c);
    }
    putchar('"');
}

/* A readable number of bytes: "152K". */
static const char *readable_bytes(uint64_t bytes, char text[16]) {
    static const char units[] = " KMGT";
    unsigned unit = 0;
    double value = (double)bytes;

    while (value >= 1024 && units[unit + 1]) {
        value /= 1024;
        unit++;
    }
    if (unit)
        snprintf(text, 16, "%.*f%c", value < 10 ? 1 : 0, value, units[unit]);
    else
        snprintf(text, 16, "%u", (unsigned)bytes);
    return text;
}

/* ---- Fields ---- */

/* Printing values of any type, by the item's layout. */

/* Elements of an array that are printed; a picture has a million. */
#define SHOWN 16
#define SHOWN_JSON 1024 /* JSON has all elements of an array up to this length, else the first SHOWN */

static int64_t signed_at(const char *at, unsigned bytes) {
    int8_t i8;
    int16_t i16;
    int32_t i32;
    int64_t i64;

    switch (bytes) {
    case 1: memcpy(&i8, at, 1); return i8;
    case 2: memcpy(&i16, at, 2); return i16;
    case 4: memcpy(&i32, at, 4); return i32;
    default: memcpy(&i64, at, 8); return i64;
    }
}

static void print_number(enum ddx_kind kind, const char *at, unsigned bytes) {
    uint64_t mask = bytes == 8 ? UINT64_MAX : ((uint64_t)1 << 8 * bytes) - 1;
    double real;

    if (kind == DDX_KIND_FLOAT) {
        float single;

        if (bytes == 4) {
            memcpy(&single, at, 4);
            real = (double)single;
        } else
            memcpy(&real, at, 8);
        if (real - real != 0) /* JSON has no infinities */
            printf("null");
        else
            printf(bytes == 4 ? "%.9g" : "%.17g", real);
    } else if (kind == DDX_KIND_UNSIGNED)
        printf("%llu", (unsigned long long)signed_at(at, bytes) & (unsigned long long)mask);
    else
        printf("%lld", (long long)signed_at(at, bytes));
}

/* Whether the bytes are text (printable up to a NUL), not a plane of pixels. */
static bool is_text(const char *at, uint64_t bytes) {
    const char *end = memchr(at, 0, (size_t)bytes);

    if (!end || bytes > 4096)
        return false;
    for (; at < end; at++)
        if (*at < ' ' || *at > 126)
            return false;
    return true;
}

static void print_array(const struct ddx_field *field, const char *at, bool json) {
    uint64_t count = field->used / field->bytes;

    if (count && field->kind == DDX_KIND_CHAR && field->count > 1 && is_text(at, field->used)) {
        json_string(at, (size_t)field->used);
        return;
    }
    if (count && field->count == 1) {
        print_number(field->kind, at, field->bytes);
        return;
    }
    uint64_t shown = count > (json ? SHOWN_JSON : SHOWN) ? SHOWN : count;
    printf("[");
    for (uint64_t i = 0; i < shown; i++) {
        printf(i ? (json ? "," : ", ") : "");
        print_number(field->kind == DDX_KIND_CHAR ? DDX_KIND_UNSIGNED : field->kind, at + i * field->bytes,
                     field->bytes);
    }
    if (count > shown && !json)
        printf(", ... %llu in all", (unsigned long long)count);
    printf("]");
}

/* The part of the name after the enclosing struct's. */
static const char *short_name(const char *name) {
    const char *dot = strrchr(name, '.');

    return dot ? dot + 1 : name;
}

static void print_json(const DDX_STORE_ITEM *item, unsigned first, unsigned end, const char *base);

/* One element of a struct, as a JSON object. */
static void print_struct(const DDX_STORE_ITEM *item, unsigned index, const char *base) {
    const struct ddx_field *field = ddx_store_field(item, index);

    if (field->count > 1)
        putchar('[');
    for (uint32_t i = 0; i < field->count; i++) {
        printf(i ? ",{" : "{");
        print_json(item, index + 1, index + 1 + field->children, base + (uint64_t)i * field->bytes);
        putchar('}');
    }
    if (field->count > 1)
        putchar(']');
}

static void print_json(const DDX_STORE_ITEM *item, unsigned first, unsigned end, const char *base) {
    for (unsigned i = first; i < end; i++) {
        const struct ddx_field *field = ddx_store_field(item, i);

        if (i > first)
            putchar(',');
        json_string(short_name(field->name), DDX_NAME_MAX);
        putchar(':');
        if (field->kind == DDX_KIND_STRUCT) {
            print_struct(item, i, base);
            i += field->children;
        } else
            print_array(field, base + field->offset, true);
    }
}

/* The layout of a video item's pictures (enum ddx_video_format of ddxvideo.h), or NULL. */
static const char *layout_of(const DDX_STORE_ITEM *item, const struct ddx_field *field, const char *at) {
    static const char *const from_16[] = {"YUV422P", "YUV444P", "GREY8", "GREY16", "RGB24"};
    int32_t format;

    if (strcmp(ddx_store_item_type(item), "DDX_VIDEO") || strcmp(field->name, "format") || field->bytes != 4)
        return NULL;
    memcpy(&format, at, sizeof format);
    if (format >= 0 && format < 4)
        return "YUV420P";
    return format >= 16 && (size_t)format - 16 < sizeof from_16 / sizeof *from_16 ? from_16[format - 16] : NULL;
}

static void print_lines(const DDX_STORE_ITEM *item, unsigned first, unsigned end, const char *base, const char *path) {
    for (unsigned i = first; i < end; i++) {
        const struct ddx_field *field = ddx_store_field(item, i);
        char name[160];

        if (field->kind != DDX_KIND_STRUCT) {
            snprintf(name, sizeof name, "%s%s", path, short_name(field->name));
            printf("%-24s ", *name ? name : "value");
            print_array(field, base + field->offset, false);
            const char *layout = layout_of(item, field, base + field->offset);
            if (layout)
                printf(" (%s)", layout);
            putchar('\n');
            continue;
        }
        for (uint32_t k = 0; k < field->count; k++) {
            if (field->count > 1)
                snprintf(name, sizeof name, "%s%s[%u].", path, short_name(field->name), (unsigned)k);
            else
                snprintf(name, sizeof name, "%s%s.", path, short_name(field->name));
            print_lines(item, i + 1, i + 1 + field->children, base + (uint64_t)k * field->bytes, name);
        }
        i += field->children;
    }
}

/* Print a frame's fields: one name and value a line, or the members of a JSON object. */
static void print_fields(const DDX_STORE_ITEM *item, const void *data, bool json) {
    const struct ddx_field *first = ddx_store_field(item, 0);
    unsigned end = 0;

    if (!first) {
        printf(json ? "\"value\":null" : "(a type that only its programs know)\n");
        return;
    }
    while (ddx_store_field(item, end))
        end++;
    if (!json)
        print_lines(item, 0, end, data, "");
    else if (end == 1 && !*first->name) {
        printf("\"value\":");
        print_array(first, data, true);
    } else {
        printf("\"value\":{");
        print_json(item, 0, end, data);
        putchar('}');
    }
}

/* ---- show ---- */

#define FIRST_WAIT 1.0 /* s, for the first value after a subscription */

/*
 * Acquire the newest value. The store may hold another machine's value from before this subscription: a newer one than
 * `begin` is waited for, and if none comes, a line has the age of the last one. 0 or -errno.
 */
static int acquire(DDX_STORE_ITEM *item, const char *name, int64_t begin, struct ddx_frame *frame) {
    bool remote = strchr(ddx_store_item_name(item), ':');
    int result = ddx_store_acquire(item, frame, remote ? FIRST_WAIT : 0, DDX_CURRENT);
    double left = FIRST_WAIT - (double)(ddx_time_now() - begin) / 1e9;

    if (result || !remote || frame->time >= begin)
        return result;
    ddx_store_release(item);
    result = ddx_store_acquire(item, frame, left > 0 ? left : 0, DDX_NEXT);
    if (result != -ETIMEDOUT)
        return result;
    result = ddx_store_acquire(item, frame, 0, DDX_CURRENT);
    if (!result)
        fprintf(stderr, "ddxctl: %s: no new value within %.0f s; the last one is %.3f s old\n", name, FIRST_WAIT,
                (double)(ddx_time_now() - frame->time) / 1e9);
    return result;
}

int command_show(DDX_STORE_ID *id, const struct request *request) {
    int64_t begin = ddx_time_now();
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);
    struct ddx_frame frame;

    if (!item)
        return complain(request->item, errno);
    int result = acquire(item, request->item, begin, &frame);
    if (result) {
        ddx_store_done_item(item);
        if (result != -ETIMEDOUT)
            return complain(request->item, result);
        fprintf(stderr, "ddxctl: %s: nothing was written yet\n", request->item);
        return 1;
    }
    double age = (double)(ddx_time_now() - frame.time) / 1e9;
    if (request->json) {
        printf("{\"name\":");
        json_string(request->item, DDX_NAME_MAX);
        printf(",\"type\":");
        json_string(ddx_store_item_type(item), DDX_NAME_MAX);
        printf(",\"sequence\":%llu,\"time_ns\":%lld,", (unsigned long long)frame.sequence, (long long)frame.time);
        print_fields(item, frame.data, true);
        printf("}\n");
    } else {
        printf("%s: %s, write %llu, %.3f s ago\n", request->item, ddx_store_item_type(item),
               (unsigned long long)frame.sequence, age);
        print_fields(item, frame.data, false);
    }
    ddx_store_release(item);
    ddx_store_done_item(item);
    return 0;
}

/* ---- list ---- */

static void print_table(const struct ddx_store_info *store, const struct ddx_item_info *items, unsigned count) {
    char size[16], bytes[16], reserved[16];

    printf("%-24s %-14s %7s %7s %8s %6s %7s %7s %10s %8s\n", "ITEM", "TYPE", "SIZE", "MEMORY", "RESERVED", "FRAMES",
           "READERS", "WRITER", "WRITES", "AGE");
    for (unsigned i = 0; i < count; i++) {
        const struct ddx_item_info *item = &items[i];
        char writer[16] = "-", age[16] = "-";

        if (item->writer_pid)
            snprintf(writer, sizeof writer, "%d", (int)item->writer_pid);
        if (item->sequence)
            snprintf(age, sizeof age, "%.2fs", (double)(ddx_time_now() - item->time) / 1e9);
        printf("%-24s %-14s %7s %7s %8s %6u %7u %7s %10llu %8s\n", item->name, item->type,
               readable_bytes(item->size, size), readable_bytes(item->bytes, bytes),
               readable_bytes(item->reserved, reserved), (unsigned)item->frames, (unsigned)item->readers, writer,
               (unsigned long long)item->sequence, age);
    }
    printf("%u items, %s used, %s reserved of %s\n", count, readable_bytes(store->bytes, bytes),
           readable_bytes(store->reserved, reserved), readable_bytes(store->budget, size));
    if (store->restarts)
        printf("its worker died or hung %u times, and was replaced\n", (unsigned)store->restarts);
}

static void print_json_items(const struct ddx_store_info *store, const struct ddx_item_info *items, unsigned count) {
    printf("{\"budget\":%llu,\"bytes\":%llu,\"reserved\":%llu,\"clients\":%u,\"pid\":%d,\"restarts\":%u,"
           "\"items\":[",
           (unsigned long long)store->budget, (unsigned long long)store->bytes, (unsigned long long)store->reserved,
           (unsigned)store->clients, (int)store->pid, (unsigned)store->restarts);
    for (unsigned i = 0; i < count; i++) {
        const struct ddx_item_info *item = &items[i];

        printf("%s{\"name\":", i ? "," : "");
        json_string(item->name, sizeof item->name);
        printf(",\"type\":");
        json_string(item->type, sizeof item->type);
        printf(",\"size\":%llu,\"frame_bytes\":%llu,\"bytes\":%llu,\"reserved\":%llu,\"frames\":%u,\"readers\":%u,"
               "\"writer_pid\":%d,\"epoch\":%u,\"sequence\":%llu,\"time_ns\":%lld,\"missed_max\":%llu}",
               (unsigned long long)item->size, (unsigned long long)item->frame_bytes, (unsigned long long)item->bytes,
               (unsigned long long)item->reserved, (unsigned)item->frames, (unsigned)item->readers,
               (int)item->writer_pid, (unsigned)item->epoch, (unsigned long long)item->sequence, (long long)item->time,
               (unsigned long long)item->missed_max);
    }
    printf("]}\n");
}

int command_list(DDX_STORE_ID *id, const struct request *request) {
    struct ddx_store_info store;
    struct ddx_item_info *items;
    unsigned count;
    int result = ddx_store_list(id, &store, &items, &count);

    if (result)
        return complain(NULL, result);
    if (request->json)
        print_json_items(&store, items, count);
    else
        print_table(&store, items, count);
    free(items);
    return 0;
}

/* ---- watch ---- */

#define WAIT 0.2 /* s between checks for a request to stop */

static volatile sig_atomic_t stop;

static void on_signal(int number) {
    (void)number;
    stop = 1;
}

static void print_write(const DDX_STORE_ITEM *item, const struct ddx_frame *frame, bool json) {
    long long late = (long long)(ddx_time_now() - frame->time) / 1000;

    if (json) {
        printf("{\"name\":");
        json_string(ddx_store_item_name(item), DDX_NAME_MAX);
        printf(",\"sequence\":%llu,\"time_ns\":%lld,\"missed\":%llu,\"wake_us\":%lld}\n",
               (unsigned long long)frame->sequence, (long long)frame->time, (unsigned long long)frame->missed, late);
    } else {
        printf("%s write %llu at %.6f s, missed %llu, seen after %lld us\n", ddx_store_item_name(item),
               (unsigned long long)frame->sequence, (double)frame->time / 1e9, (unsigned long long)frame->missed, late);
    }
    fflush(stdout);
}

int command_watch(DDX_STORE_ID *id, const struct request *request) {
    struct sigaction action = {.sa_handler = on_signal};
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);
    unsigned seen = 0;
    int result = 0;

    if (!item)
        return complain(request->item, errno);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    while (!stop && !ferror(stdout) && (request->count == 0 || seen < request->count)) {
        struct ddx_frame frame;

        result = ddx_store_acquire(item, &frame, WAIT, DDX_NEXT);
        if (result == -ETIMEDOUT) {
            result = 0;
            continue;
        }
        if (result)
            break;
        print_write(item, &frame, request->json);
        ddx_store_release(item);
        seen++;
    }
    ddx_store_done_item(item);
    return result ? complain(request->item, result) : 0;
}
