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

/* ---- SHA-256 ---- */

static const uint32_t rounds[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static uint32_t rotated(uint32_t x, unsigned bits) {
    return x >> bits | x << (32 - bits);
}

static void expand(const uint8_t block[64], uint32_t words[64]) {
    for (unsigned i = 0; i < 16; i++)
        words[i] = (uint32_t)block[4 * i] << 24 | (uint32_t)block[4 * i + 1] << 16 | (uint32_t)block[4 * i + 2] << 8 |
                   block[4 * i + 3];
    for (unsigned i = 16; i < 64; i++) {
        uint32_t a = words[i - 15], b = words[i - 2];

        words[i] = words[i - 16] + (rotated(a, 7) ^ rotated(a, 18) ^ a >> 3) + words[i - 7] +
                   (rotated(b, 17) ^ rotated(b, 19) ^ b >> 10);
    }
}

static void add_block(uint32_t hash[8], const uint8_t block[64]) {
    uint32_t words[64], s[8];

    expand(block, words);
    memcpy(s, hash, sizeof s);
    for (unsigned i = 0; i < 64; i++) {
        uint32_t e = s[4], a = s[0];
        uint32_t first = s[7] + (rotated(e, 6) ^ rotated(e, 11) ^ rotated(e, 25)) + ((e & s[5]) ^ (~e & s[6])) +
                         rounds[i] + words[i];
        uint32_t second = (rotated(a, 2) ^ rotated(a, 13) ^ rotated(a, 22)) + ((a & s[1]) ^ (a & s[2]) ^ (s[1] & s[2]));

        memmove(s + 1, s, 7 * sizeof *s);
        s[4] += first;
        s[0] = first + second;
    }
    for (unsigned i = 0; i < 8; i++)
        hash[i] += s[i];
}

void sha256(const void *data, size_t size, uint8_t digest[SHA256_BYTES]) {
    uint32_t hash[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    uint8_t tail[128] = {0};
    size_t whole = size / 64 * 64, rest = size - whole, length = rest < 56 ? 64 : 128;

    for (size_t i = 0; i < whole; i += 64)
        add_block(hash, (const uint8_t *)data + i);
    memcpy(tail, (const uint8_t *)data + whole, rest);
    tail[rest] = 0x80;
    for (unsigned i = 0; i < 8; i++)
        tail[length - 1 - i] = (uint8_t)((uint64_t)size * 8 >> 8 * i);
    for (size_t i = 0; i < length; i += 64)
        add_block(hash, tail + i);
    for (unsigned i = 0; i < SHA256_BYTES; i++)
        digest[i] = (uint8_t)(hash[i / 4] >> (24 - 8 * (i % 4)));
}

/* ---- Hash of a type ---- */

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
