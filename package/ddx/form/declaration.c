/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An item's fields as a C declaration, in types of fixed width, and such a declaration as fields again. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fields.h"

#define NESTING_MAX 8
#define FIELDS_MAX 200

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
        if (fields->field->bound > 1)
            fprintf(to, "[%u]", (unsigned)fields->field->bound);
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

struct parser {
    const char *at;
    struct form_fields *fields;
};

/* The next word: a name, a number, or one other character. Empty at the end. */
static void next_word(struct parser *parser, char word[DDX_NAME_MAX + 1]) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_0123456789";

    parser->at += strspn(parser->at, " ");
    size_t length = strspn(parser->at, letters);
    if (!length && *parser->at)
        length = 1;
    snprintf(word, DDX_NAME_MAX + 1, "%.*s", (int)(length > DDX_NAME_MAX ? 0 : length), parser->at);
    parser->at += length;
}

static bool accept(struct parser *parser, char c) {
    parser->at += strspn(parser->at, " ");
    if (*parser->at != c)
        return false;
    parser->at++;
    return true;
}

static int parse_members(struct parser *parser, unsigned depth);

/* "float x[3];" or "struct { ... } y;" */
static int parse_member(struct parser *parser, unsigned depth) {
    char word[DDX_NAME_MAX + 1];
    unsigned index = parser->fields->count++;

    if (index >= FIELDS_MAX)
        return -EINVAL;
    struct form_field *field = &parser->fields->field[index];
    next_word(parser, word);
    if (!strcmp(word, "struct")) {
        int error = accept(parser, '{') ? parse_members(parser, depth + 1) : -EINVAL;

        if (error)
            return error;
        field->kind = DDX_KIND_STRUCT;
        field->children = parser->fields->count - index - 1;
    } else {
        for (size_t i = 0; i < TYPES && !field->kind; i++)
            if (!strcmp(word, types[i].name)) {
                field->kind = types[i].kind;
                field->bytes = types[i].bytes;
            }
    }
    if (depth)
        next_word(parser, field->name);
    if (!field->kind || (depth && !*field->name))
        return -EINVAL;
    field->bound = 1;
    if (accept(parser, '[')) {
        next_word(parser, word);
        unsigned long bound = strtoul(word, NULL, 10);
        if (!bound || bound > 1 << 30 || !accept(parser, ']'))
            return -EINVAL;
        field->bound = (uint32_t)bound;
    }
    field->count = field->bound;
    return !depth || accept(parser, ';') ? 0 : -EINVAL;
}

static int parse_members(struct parser *parser, unsigned depth) {
    if (depth > NESTING_MAX)
        return -EINVAL;
    bool any = false;
    for (; !accept(parser, '}'); any = true) {
        int error = parse_member(parser, depth);

        if (error)
            return error;
    }
    return any ? 0 : -EINVAL;
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
    fields->count = 0;
    fields->field = calloc(FIELDS_MAX + 1, sizeof *fields->field);
    if (!fields->field)
        return -ENOMEM;
    struct parser parser = {declaration, fields};
    char word[DDX_NAME_MAX + 1];
    int error;
    next_word(&parser, word);
    if (!strcmp(word, "struct")) {
        error = accept(&parser, '{') ? parse_members(&parser, 1) : -EINVAL;
    } else {
        parser.at = declaration;
        error = parse_member(&parser, 0);
    }
    next_word(&parser, word);
    if (!error && *word)
        error = -EINVAL;
    return error ? error : use(fields, extents);
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
