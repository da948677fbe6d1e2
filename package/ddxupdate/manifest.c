/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "manifest.h"

#include <stdbool.h>
#include <string.h>

struct text {
    const char *at, *end;
};

/* Take the value of the next line if it has this name; a value has 1 to MANIFEST_WORD - 1 printable characters. */
static bool take(struct text *text, const char *name, char value[MANIFEST_WORD]) {
    const size_t length = strlen(name), left = (size_t)(text->end - text->at);
    const char *const end = memchr(text->at, '\n', left);

    if (!end || (size_t)(end - text->at) <= length || memcmp(text->at, name, length) != 0 || text->at[length] != '=')
        return false;
    const char *const begin = text->at + length + 1;
    const size_t size = (size_t)(end - begin);
    if (!size || size >= MANIFEST_WORD)
        return false;
    for (size_t i = 0; i < size; i++)
        if (begin[i] < ' ' || begin[i] > '~')
            return false;
    memcpy(value, begin, size);
    value[size] = 0;
    text->at = end + 1;
    return true;
}

static bool take_number(struct text *text, const char *name, uint64_t *number) {
    char value[MANIFEST_WORD];

    if (!take(text, name, value) || strlen(value) > 15 || value[strspn(value, "0123456789")])
        return false;
    *number = 0;
    for (const char *digit = value; *digit; digit++)
        *number = *number * 10 + (uint64_t)(*digit - '0');
    return true;
}

static bool take_hash(struct text *text, uint8_t hash[MANIFEST_HASH]) {
    static const char digits[] = "0123456789abcdef";
    char value[MANIFEST_WORD];

    if (!take(text, "sha256", value) || strlen(value) != 2 * MANIFEST_HASH || value[strspn(value, digits)])
        return false;
    for (int i = 0; i < MANIFEST_HASH; i++)
        hash[i] = (uint8_t)((strchr(digits, value[2 * i]) - digits) << 4 | (strchr(digits, value[2 * i + 1]) - digits));
    return true;
}

const char *manifest_parse(const char *bytes, size_t size, struct manifest *manifest) {
    struct text text = {bytes, bytes + size};

    if (!take(&text, "board", manifest->board))
        return "board";
    if (!take_number(&text, "layout", &manifest->layout))
        return "layout";
    if (!take(&text, "version", manifest->version))
        return "version";
    if (!take_number(&text, "serial", &manifest->serial))
        return "serial";
    if (!take_number(&text, "size", &manifest->size) || !manifest->size || manifest->size % 512 ||
        manifest->size > (uint64_t)MANIFEST_PIECES * MEBIBYTE)
        return "size";
    manifest->count = (unsigned)((manifest->size + MEBIBYTE - 1) / MEBIBYTE);
    for (unsigned i = 0; i < manifest->count; i++)
        if (!take_hash(&text, manifest->hashes[i]))
            return "sha256";
    return text.at == text.end ? NULL : "the end";
}

size_t manifest_piece(const struct manifest *manifest, unsigned index) {
    const uint64_t left = manifest->size - (uint64_t)index * MEBIBYTE;

    return left < MEBIBYTE ? (size_t)left : MEBIBYTE;
}
