/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Printing values of any type, by the item's layout. */
#include <stdio.h>
#include <string.h>

#include "ddxctl.h"

/* Elements of an array that are printed; a picture has a million. */
#define SHOWN 16
#define SHOWN_JSON 1024 /* in JSON all elements up to this number, of longer arrays the first SHOWN */

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

void print_fields(const DDX_STORE_ITEM *item, const void *data, bool json) {
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
