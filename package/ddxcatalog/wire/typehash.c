/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "typehash.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sha256.h"

#define ARRAY 48     /* added to the number of a kind for an array of it, */
#define SEQUENCE 144 /* and for a sequence */

/* "ddx/SENSOR" is "ddx/msg/SENSOR". */
static void write_type(FILE *to, const char *type) {
    const char *slash = strchr(type, '/');

    fprintf(to, "%.*s/msg%s", (int)(slash ? slash - type : 0), type, slash ? slash : "");
}

static void write_field(FILE *to, const struct description_field *field) {
    unsigned many = field->sequence ? SEQUENCE : field->count ? ARRAY : 0;

    fprintf(to,
            "{\"name\": \"%s\", \"type\": {\"type_id\": %u, \"capacity\": %u, \"string_capacity\": 0, "
            "\"nested_type_name\": \"",
            field->name, (unsigned)field->kind + many, (unsigned)field->count);
    if (field->kind == DESCRIPTION_NESTED)
        write_type(to, field->type);
    fputs("\"}}", to);
}

static void write_message(FILE *to, const struct description_message *message) {
    fputs("{\"type_name\": \"", to);
    write_type(to, message->type);
    fputs("\", \"fields\": [", to);
    for (unsigned i = 0; i < message->count; i++) {
        fputs(i ? ", " : "", to);
        write_field(to, &message->fields[i]);
    }
    fputs("]}", to);
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct description_message *)a)->type, ((const struct description_message *)b)->type);
}

/* The text to hash; the contained messages are sorted by name. The caller frees it. */
static char *text_of(const struct description *description, size_t *size) {
    unsigned others = description->count - 1;
    struct description_message *sorted = malloc((others + 1) * sizeof *sorted);
    char *text = NULL;
    FILE *to = sorted ? open_memstream(&text, size) : NULL;

    if (!to) {
        free(sorted);
        return NULL;
    }
    memcpy(sorted, description->messages + 1, others * sizeof *sorted);
    qsort(sorted, others, sizeof *sorted, by_name);
    fputs("{\"type_description\": ", to);
    write_message(to, description->messages);
    fputs(", \"referenced_type_descriptions\": [", to);
    for (unsigned i = 0; i < others; i++) {
        fputs(i ? ", " : "", to);
        write_message(to, &sorted[i]);
    }
    fputs("]}", to);
    free(sorted);
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

int typehash(const struct description *description, char text[TYPEHASH_MAX]) {
    uint8_t digest[SHA256_BYTES];
    size_t size;
    char *hashed = text_of(description, &size);

    if (!hashed)
        return -ENOMEM;
    sha256(hashed, size, digest);
    free(hashed);
    strcpy(text, "RIHS01_");
    for (unsigned i = 0; i < SHA256_BYTES; i++)
        sprintf(text + 7 + 2 * i, "%02x", digest[i]);
    return 0;
}
