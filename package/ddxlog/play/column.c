/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "column.h"

#include <bytes.h>
#include <inttypes.h>
#include <string.h>

/* Arrays of char are texts. */
static bool is_text(const struct form_leaf *leaf) {
    return leaf->kind == DDX_KIND_CHAR && leaf->count > 1;
}

static bool is_large(const struct form_leaf *leaf) {
    return leaf->count > COLUMN_ELEMENTS_MAX && !is_text(leaf);
}

void column_names(FILE *file, const struct form_leaf *leaf) {
    if (leaf->count == 1 || is_text(leaf) || is_large(leaf)) {
        fprintf(file, ",%s", leaf->name);
        return;
    }
    for (uint32_t i = 0; i < leaf->count; i++)
        fprintf(file, ",%s[%u]", leaf->name, (unsigned)i);
}

static void write_number(FILE *file, const struct form_leaf *leaf, const unsigned char *at) {
    struct cursor cursor = {at, at + leaf->bytes, false};
    uint64_t number = cursor_number(&cursor, leaf->bytes);
    unsigned unused = 64 - 8 * leaf->bytes;

    if (leaf->kind == DDX_KIND_FLOAT && leaf->bytes == 4) {
        uint32_t bits = (uint32_t)number;
        float value;

        memcpy(&value, &bits, sizeof value);
        fprintf(file, "%.9g", (double)value); /* enough digits to read the same number again */
    } else if (leaf->kind == DDX_KIND_FLOAT) {
        double value;

        memcpy(&value, &number, sizeof value);
        fprintf(file, "%.17g", value);
    } else if (leaf->kind == DDX_KIND_UNSIGNED) {
        fprintf(file, "%" PRIu64, number);
    } else {
        fprintf(file, "%" PRId64, (int64_t)(number << unused) >> unused);
    }
}

/* The text up to its zero byte, in quotes; for other bytes their size and CRC32. */
static void write_text(FILE *file, const unsigned char *at, size_t size) {
    size_t length = strnlen((const char *)at, size);

    for (size_t i = 0; i < length; i++)
        if (at[i] < ' ' || at[i] == 127) {
            fprintf(file, "%zu bytes crc32=%08" PRIx32, size, crc32_of(0, at, size));
            return;
        }
    fputc('"', file);
    for (size_t i = 0; i < length; i++)
        fputs(at[i] == '"' ? "\"\"" : (char[]){(char)at[i], 0}, file);
    fputc('"', file);
}

void column_values(FILE *file, const struct form_leaf *leaf, const unsigned char *message) {
    const unsigned char *at = message + leaf->message;
    size_t size = (size_t)leaf->bytes * leaf->count;

    if (is_text(leaf) && size <= 4096) {
        fputc(',', file);
        write_text(file, at, size);
    } else if (is_text(leaf) || is_large(leaf)) {
        fprintf(file, ",%zu bytes crc32=%08" PRIx32, size, crc32_of(0, at, size));
    } else {
        for (uint32_t i = 0; i < leaf->count; i++) {
            fputc(',', file);
            write_number(file, leaf, at + (size_t)i * leaf->bytes);
        }
    }
}
