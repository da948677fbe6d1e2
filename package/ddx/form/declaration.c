/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An item's fields as a C declaration, in types of fixed width, and such a declaration as fields again. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fields.h"
#include "type.h"

static const struct {
    const char *name;
    enum ddx_kind kind;
    uint32_t bytes;
} types[] = {
    {"int8_t", DDX_KIND_INT, 1},        {"int16_t", DDX_KIND_INT, 2},       {"int32_t", DDX_KIND_INT, 4},
    {"int64_t", DDX_KIND_INT, 8},       {"uint8_t", DDX_KIND_UNSIGNED, 1},  {"uint16_t", DDX_KIND_UNSIGNED, 2},
    {"uint32_t", DDX_KIND_UNSIGNED, 4}, {"uint64_t", DDX_KIND_UNSIGNED, 8}, {"float", DDX_KIND_FLOAT, 4},
    {"double", DDX_KIND_FLOAT, 8},      {"char", DDX_KIND_CHAR, 1},
};
#define TYPES (sizeof types / sizeof *types)

static const char *type_name(const struct form_field *field) {
    for (size_t i = 0; i < TYPES; i++)
        if (types[i].kind == field->kind && types[i].bytes == field->bytes)
            return types[i].name;
    return "char";
}

static void write_fields(FILE *to, const struct form_fields *fields, unsigned first, unsigned end) {
    for (unsigned i = first; i < end; i += 1 + fields->field[i].children) {
        const struct form_field *field = &fields->field[i];

        if (field->kind == DDX_KIND_STRUCT) {
            fputs("struct { ", to);
            write_fields(to, fields, i + 1, i + 1 + field->children);
            fprintf(to, "} %s", field->name);
        } else {
            fprintf(to, "%s %s", type_name(field), field->name);
        }
        if (field->bound > 1)
            fprintf(to, "[%u]", (unsigned)field->bound);
        fputs("; ", to);
    }
}

char *form_declaration(const struct form_fields *fields) {
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    if (fields->count == 1 && !*fields->field->name) {
        fputs(type_name(fields->field), to);
    } else {
        fputs("struct { ", to);
        write_fields(to, fields, 0, fields->count);
        fputs("}", to);
    }
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

char *form_extents(const struct form_fields *fields) {
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    const char *space = "";
    for (unsigned i = 0; i < fields->count; i += 1 + fields->field[i].children)
        if (fields->field[i].extent) {
            fprintf(to, "%s%s=%llu", space, fields->field[i].name,
                    (unsigned long long)fields->field[i].bytes * fields->field[i].count);
            space = " ";
        }
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

/* Apply the extents. A struct field has no size here, so it cannot have an extent. */
static int use(struct form_fields *fields, const char *extents) {
    while (*extents) {
        size_t length = strcspn(extents, "=");
        char *end;
        struct form_field *found = NULL;

        for (unsigned i = 0; i < fields->count && !found; i += 1 + fields->field[i].children)
            if (strlen(fields->field[i].name) == length && !strncmp(fields->field[i].name, extents, length))
                found = &fields->field[i];
        if (!found || extents[length] != '=' || !found->bytes)
            return -EINVAL;
        unsigned long long bytes = strtoull(extents + length + 1, &end, 10);
        if (end == extents + length + 1 || bytes / found->bytes > found->bound || (bytes && bytes < found->bytes))
            return -EINVAL;
        found->count = (uint32_t)(bytes / found->bytes);
        found->extent = true;
        extents = end + strspn(end, " ");
    }
    return 0;
}

int form_parse(const char *declaration, const char *extents, struct form_fields *fields) {
    struct ddx_layout *layout;
    int error = ddx_layout_parse_portable(declaration, &layout);

    *fields = (struct form_fields){NULL, 0};
    if (error)
        return error;
    fields->field = calloc(layout->field_count, sizeof *fields->field);
    for (; fields->field && fields->count < layout->field_count; fields->count++) {
        const struct ddx_layout_field *from = &layout->field[fields->count];
        struct form_field *to = &fields->field[fields->count];
        const char *dot = strrchr(from->name, '.');

        *to = (struct form_field){
            .kind = from->kind, .count = from->count, .bound = from->count, .children = from->children};
        if (to->kind != DDX_KIND_STRUCT) /* a struct's size depends on the machine */
            to->bytes = from->bytes;
        snprintf(to->name, sizeof to->name, "%s", dot ? dot + 1 : from->name);
    }
    free(layout);
    return fields->field ? use(fields, extents) : -ENOMEM;
}

unsigned form_list_extents(char *text, struct ddx_extent *extents, unsigned room) {
    unsigned count = 0;

    for (char *word, *rest = text; count < room && (word = strtok_r(rest, " ", &rest));) {
        char *equals = strchr(word, '=');

        if (!equals)
            continue;
        *equals = 0;
        extents[count++] = (struct ddx_extent){word, strtoull(equals + 1, NULL, 10)};
    }
    return count;
}
