/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "download.h"

#include <string.h>

#include "scgi.h"

#define DIGITS 18 /* of a number that surely fits */

/* A number without sign; the length of its text, 0: it is none. */
static size_t number(uint64_t *value, const char *text, size_t size) {
    size_t length = 0;

    *value = 0;
    while (length < size && length < DIGITS && text[length] >= '0' && text[length] <= '9')
        *value = 10 * *value + (uint64_t)(text[length++] - '0');
    return length < size && text[length] >= '0' && text[length] <= '9' ? 0 : length;
}

/* "bytes=100-" or "bytes=100-199" */
static bool take_range(struct download *wanted, const char *text) {
    static const char unit[] = "bytes=";

    if (strncmp(text, unit, strlen(unit)) != 0)
        return false;
    text += strlen(unit);
    size_t length = number(&wanted->first, text, strlen(text));
    if (!length || text[length] != '-')
        return false;
    text += length + 1;
    wanted->last = UINT64_MAX;
    return !*text || (number(&wanted->last, text, strlen(text)) == strlen(text) && wanted->last >= wanted->first);
}

/* No two recordings have the same name, so a name between quotes stands for a file's contents. */
static bool is_tag(const char *text, const char *name) {
    size_t length = strlen(name);

    return *text == '"' && !strncmp(text + 1, name, length) && !strcmp(text + 1 + length, "\"");
}

bool download_parse(struct download *wanted, const char *text, const char *range, const char *if_range) {
    if (!name_parse(wanted->name, sizeof wanted->name, text, strlen(text)))
        return false;
    wanted->is_part = range && take_range(wanted, range) && (!if_range || is_tag(if_range, wanted->name));
    if (!wanted->is_part) {
        wanted->first = 0;
        wanted->last = UINT64_MAX;
    }
    return true;
}

size_t download_hear(uint64_t *size, const char *bytes, size_t count) {
    size_t length = number(size, bytes, count);

    return length && length < count && bytes[length] == '\n' ? length + 1 : 0;
}

bool download_limit(struct download *wanted, uint64_t size) {
    if (wanted->is_part && wanted->first >= size)
        return false;
    if (wanted->last >= size)
        wanted->last = size - 1; /* of an empty file: none, since the next number is 0 again */
    return true;
}
