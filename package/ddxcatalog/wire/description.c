/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "description.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *name;
    enum description_kind kind;
} kinds[] = {
    {"int8", DESCRIPTION_INT8},      {"uint8", DESCRIPTION_UINT8},   {"int16", DESCRIPTION_INT16},
    {"uint16", DESCRIPTION_UINT16},  {"int32", DESCRIPTION_INT32},   {"uint32", DESCRIPTION_UINT32},
    {"int64", DESCRIPTION_INT64},    {"uint64", DESCRIPTION_UINT64}, {"float32", DESCRIPTION_FLOAT},
    {"float64", DESCRIPTION_DOUBLE}, {"string", DESCRIPTION_STRING},
};

/* One entry more in an array. */
static void *grown(void *array, unsigned count, size_t size) {
    return count & (count - 1) ? array : realloc(array, (count ? 2 * (size_t)count : 1) * size);
}

static int add_message(struct description *description, const char *type) {
    struct description_message *more = grown(description->messages, description->count, sizeof *more);

    if (!more)
        return -ENOMEM;
    description->messages = more;
    struct description_message *message = &more[description->count++];
    *message = (struct description_message){.fields = NULL};
    /* "ddx/msg/SENSOR" and "ddx/SENSOR" are the same. */
    const char *slash = strstr(type, "/msg/");
    snprintf(message->type, sizeof message->type, "%.*s%s", (int)(slash ? slash - type : 0), type,
             slash ? slash + 4 : type);
    return 0;
}

static void make_unique(const struct description_message *message, struct description_field *field) {
    unsigned same = 1;

    for (unsigned i = 0; i < message->count; i++)
        same += !strcmp(message->fields[i].name, field->name);
    if (same > 1)
        snprintf(field->name + strnlen(field->name, DESCRIPTION_NAME - 20), 20, "_again%u", same);
}

/* "float32[4] speed" */
static int add_field(struct description_message *message, const char *line) {
    struct description_field field = {.kind = DESCRIPTION_NESTED};
    char type[DESCRIPTION_NAME];

    if (sscanf(line, "%159s %159s", type, field.name) != 2)
        return -EINVAL;
    char *bound = strchr(type, '[');
    if (bound) {
        field.count = (uint32_t)strtoul(bound + 1, NULL, 10);
        field.sequence = bound[1] == ']';
        *bound = 0;
    }
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (!strcmp(type, kinds[i].name))
            field.kind = kinds[i].kind;
    if (field.kind == DESCRIPTION_NESTED)
        strcpy(field.type, type);
    make_unique(message, &field);
    struct description_field *more = grown(message->fields, message->count, sizeof *more);
    if (!more)
        return -ENOMEM;
    message->fields = more;
    message->fields[message->count++] = field;
    return 0;
}

static int add_line(struct description *description, const char *line) {
    if (!*line || *line == '=')
        return 0;
    if (!strncmp(line, "MSG: ", 5))
        return add_message(description, line + 5);
    return add_field(&description->messages[description->count - 1], line);
}

static bool is_complete(const struct description *description) {
    for (unsigned i = 0; i < description->count; i++) {
        const struct description_message *message = &description->messages[i];

        if (!message->count)
            return false;
        for (unsigned k = 0; k < message->count; k++)
            if (message->fields[k].kind == DESCRIPTION_NESTED &&
                !description_find(description, message->fields[k].type))
                return false;
    }
    return true;
}

int description_parse(const char *type, const char *schema, struct description **result) {
    struct description *description = calloc(1, sizeof *description);
    char line[2 * DESCRIPTION_NAME + 16];
    int error = description ? add_message(description, type) : -ENOMEM;

    while (!error && *schema) {
        size_t length = strcspn(schema, "\n");

        if (length >= sizeof line)
            error = -EINVAL;
        else
            memcpy(line, schema, length), line[length] = 0;
        if (!error)
            error = add_line(description, line);
        schema += length + (schema[length] == '\n');
    }
    if (!error && !is_complete(description))
        error = -EINVAL;
    if (error)
        description_free(description);
    else
        *result = description;
    return error;
}

void description_free(struct description *description) {
    if (!description)
        return;
    for (unsigned i = 0; i < description->count; i++)
        free(description->messages[i].fields);
    free(description->messages);
    free(description);
}

const struct description_message *description_find(const struct description *description, const char *type) {
    for (unsigned i = 0; i < description->count; i++)
        if (!strcmp(description->messages[i].type, type))
            return &description->messages[i];
    return NULL;
}
