/* SPDX-License-Identifier: GPL-2.0-or-later */
/* An item's fields as a ROS 2 message definition, whose rules for names are stricter than C's. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fields.h"

#define NAME_ROOM 160
#define PACKAGE "ddx"

/* Lower case, digits and single underscores: "gearsLeft_" becomes "gears_left". */
static void field_name(const char *name, char out[NAME_ROOM]) {
    size_t length = 0;

    if (!isalpha((unsigned char)*name)) {
        strcpy(out, "f");
        length = 1;
    }
    for (const char *c = name; *c && length < NAME_ROOM - 16; c++) {
        bool hump =
            isupper((unsigned char)*c) && c > name && isalnum((unsigned char)c[-1]) && !isupper((unsigned char)c[-1]);

        if ((hump || *c == '_') && length && out[length - 1] != '_')
            out[length++] = '_';
        if (isalnum((unsigned char)*c))
            out[length++] = (char)tolower((unsigned char)*c);
    }
    while (length && out[length - 1] == '_')
        length--;
    out[length] = 0;
}

/* If two fields get the same name, the later one gets a number. */
static void unique_name(const struct form_fields *fields, unsigned first, unsigned index, char out[NAME_ROOM]) {
    char other[NAME_ROOM];
    unsigned same = 1;

    field_name(*fields->field[index].name ? fields->field[index].name : "value", out);
    for (unsigned i = first; i < index; i += 1 + fields->field[i].children) {
        field_name(fields->field[i].name, other);
        same += !strcmp(other, out);
    }
    if (same > 1)
        sprintf(out + strlen(out), "_again%u", same);
}

/* Letters and digits, the first one a capital: "DDX_VIDEO" becomes "DDXVIDEO", a field "imu_raw" adds "ImuRaw". */
static void add_type_name(char name[NAME_ROOM], const char *part) {
    size_t length = strlen(name);
    bool capital = true;

    if (!length && !isalpha((unsigned char)*part))
        name[length++] = 'T';
    for (; *part && length < NAME_ROOM - 1; part++) {
        if (isalnum((unsigned char)*part))
            name[length++] = (char)(capital ? toupper((unsigned char)*part) : *part);
        capital = !isalnum((unsigned char)*part);
    }
    name[length] = 0;
}

static void write_type(FILE *to, const struct form_field *field) {
    int bits = (int)field->bytes * 8;

    switch (field->kind) {
    case DDX_KIND_INT: fprintf(to, "int%d", bits); break;
    case DDX_KIND_FLOAT: fprintf(to, "float%d", bits); break;
    default: fprintf(to, "uint%d", bits); break; /* also for char, which ROS defines inconsistently */
    }
}

static void write_message(FILE *to, const struct form_fields *fields, unsigned first, unsigned end, const char *type) {
    char name[NAME_ROOM], inner[NAME_ROOM];

    for (unsigned i = first; i < end; i += 1 + fields->field[i].children) {
        const struct form_field *field = &fields->field[i];

        if (!field->count) /* ROS has no arrays without elements */
            continue;
        unique_name(fields, first, i, name);
        if (field->kind == DDX_KIND_STRUCT) {
            strcpy(inner, type);
            add_type_name(inner, name);
            fprintf(to, PACKAGE "/%s", inner);
        } else {
            write_type(to, field);
        }
        if (field->bound > 1)
            fprintf(to, "[%u]", (unsigned)field->count);
        fprintf(to, " %s\n", name);
    }
    for (unsigned i = first; i < end; i += 1 + fields->field[i].children) {
        if (fields->field[i].kind != DDX_KIND_STRUCT || !fields->field[i].count)
            continue;
        unique_name(fields, first, i, name);
        strcpy(inner, type);
        add_type_name(inner, name);
        fprintf(to, "%.80s\nMSG: " PACKAGE "/%s\n",
                "================================================================================", inner);
        write_message(to, fields, i + 1, i + 1 + fields->field[i].children, inner);
    }
}

char *form_schema(const struct form_fields *fields, const char *type) {
    char *text = NULL, name[NAME_ROOM] = "";
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    add_type_name(name, type);
    write_message(to, fields, 0, fields->count, name);
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

char *form_schema_name(const char *type) {
    char *text, name[NAME_ROOM] = "";

    add_type_name(name, type);
    return asprintf(&text, PACKAGE "/msg/%s", name) < 0 ? NULL : text;
}
