/* SPDX-License-Identifier: GPL-2.0-or-later */
/* "wheel[2].speed=1.5": finds the field in the item's layout, and parses the value according to the field's kind. */
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddxctl.h"

/* The left side of the "=": a field, or one element of it. */
struct place {
    const struct ddx_field *field;
    uint64_t offset, count; /* elements that the value may set */
};

static char problem[1024];
static char asked[2 * DDX_NAME_MAX]; /* the path as typed */

static const char *wrong(const char *format, ...) __attribute__((format(printf, 1, 2)));
static const char *wrong(const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(problem, sizeof problem, format, arguments);
    va_end(arguments);
    return problem;
}

/* Parse an index such as "[3]" at *at, if there is one. NULL, or the error text. */
static const char *index_at(const char **at, const struct ddx_field *field, bool *there, uint64_t *index) {
    uint64_t count = field->used / field->bytes;
    char *end;

    *there = **at == '[';
    *index = 0;
    if (!*there)
        return NULL;
    const char *digits = *at + 1;
    errno = 0;
    *index = strtoull(digits, &end, 10);
    if (*digits < '0' || *digits > '9' || *end != ']')
        return wrong("%s: an index is a number in brackets", field->name);
    if (errno || *index >= count)
        return wrong("%s: its elements are 0 to %llu", field->name, (unsigned long long)count - 1);
    *at = end + 1;
    return NULL;
}

/* Error text with the names of the outermost fields. */
static const char *no_such_field(const DDX_STORE_ITEM *item, int length, const char *path) {
    const struct ddx_field *field;
    const char *text = wrong("%.*s: no such field; there are", length, path);

    for (unsigned i = 0; (field = ddx_store_field(item, i)); i += 1 + field->children) {
        size_t used = strlen(problem);

        snprintf(problem + used, sizeof problem - used, "%s %s", i ? "," : "", *field->name ? field->name : "value");
    }
    return text;
}

/* Follow the path "a[1].b.c[2]" field by field; `end` is the byte after it. */
static const char *find(const DDX_STORE_ITEM *item, const char *path, const char *end, struct place *place) {
    char name[DDX_NAME_MAX + 1] = "";
    const char *at = path;
    uint64_t inside = 0, index;

    for (;;) {
        size_t length = strcspn(at, ".[="), before = strlen(name);
        bool there;

        if (before + length + 2 > sizeof name)
            return no_such_field(item, (int)(end - path), path);
        snprintf(name + before, sizeof name - before, "%s%.*s", before ? "." : "", (int)length, at);
        at += length;
        place->field = ddx_store_field_named(item, name);
        if (!place->field)
            return no_such_field(item, (int)(at - path), path);
        if (!place->field->used)
            return wrong("%s: no byte of it is in use", name);
        const char *bad = index_at(&at, place->field, &there, &index);
        if (bad)
            return bad;
        place->offset = place->field->offset + inside + index * place->field->bytes;
        place->count = there ? 1 : place->field->used / place->field->bytes;
        inside += index * place->field->bytes;
        bool nested = place->field->kind == DDX_KIND_STRUCT;
        if (nested && place->count > 1)
            return wrong("%s: an array of structs: %s[0]...", name, name);
        if (nested && at == end)
            return wrong("%s: a struct; name a field in it", name);
        if (at == end)
            return NULL;
        if (!nested || *at != '.')
            return no_such_field(item, (int)(end - path), path);
        at++;
    }
}

/* Integers of any width are stored as their low bytes: the machines of this library are little-endian. */
static const char *put_integer(const struct ddx_field *field, void *to, const char *text, const char **end) {
    const char *digits = text + strspn(text, " ");
    bool negative = *digits == '-';
    unsigned bits = 8 * field->bytes;
    bool sign = field->kind != DDX_KIND_UNSIGNED;
    uint64_t most = field->kind == DDX_KIND_INT ? UINT64_MAX >> (65 - bits) : UINT64_MAX >> (64 - bits);
    uint64_t least = sign ? (uint64_t)1 << (bits - 1) : 0; /* below zero */
    char *stop;

    digits += negative || *digits == '+';
    bool hexadecimal = *digits == '0' && (digits[1] | 32) == 'x'; /* no octal: 010 is ten */
    errno = 0;
    uint64_t value = strtoull(digits, &stop, hexadecimal ? 16 : 10);
    if (negative)
        value = 0 - value; /* modulo 2^64 */
    bool fits = !errno && (negative ? 0 - value <= least : value <= most);
    if (*digits < '0' || *digits > '9' || !fits || (*stop && *stop != ','))
        return wrong("%s: takes a whole number from %s%llu to %llu, not %s", asked, sign ? "-" : "",
                     (unsigned long long)least, (unsigned long long)most, text);
    *end = stop;
    if (to)
        memcpy(to, &value, field->bytes);
    return NULL;
}

static const char *put_real(const struct ddx_field *field, void *to, const char *text, const char **end) {
    double most = field->bytes == 4 ? (double)FLT_MAX : DBL_MAX;
    char *stop;
    double value = strtod(text, &stop);

    if (stop == text || !(fabs(value) <= most) || (*stop && *stop != ','))
        return wrong("%s: takes a number from %g to %g, not %s", asked, -most, most, text);
    *end = stop;
    float single = (float)value;
    if (to)
        memcpy(to, field->bytes == 4 ? (void *)&single : (void *)&value, field->bytes);
    return NULL;
}

static const char *put_text(const struct place *place, char *to, const char *text) {
    size_t length = strlen(text);

    if (length >= place->count)
        return wrong("%s: takes a text of 0 to %llu bytes, not %zu", asked, (unsigned long long)place->count - 1,
                     length);
    if (to) {
        memset(to, 0, (size_t)place->count);
        memcpy(to, text, length);
    }
    return NULL;
}

static const char *put_numbers(const struct place *place, char *to, const char *text) {
    const struct ddx_field *field = place->field;
    uint64_t i = 0;

    for (const char *at = text;; at++) {
        const char *bad = i >= place->count ? "more"
                          : field->kind == DDX_KIND_FLOAT
                              ? put_real(field, to ? to + i * field->bytes : NULL, at, &at)
                              : put_integer(field, to ? to + i * field->bytes : NULL, at, &at);

        if (bad && i < place->count)
            return bad;
        i++;
        if (bad || !*at)
            break;
    }
    if (i == place->count)
        return NULL;
    return wrong("%s: takes %llu numbers, or name one of them: %s[0]", asked, (unsigned long long)place->count, asked);
}

const char *change_field(const DDX_STORE_ITEM *item, void *data, const char *change, bool apply) {
    const char *end = strchr(change, '=');
    const char *path = change;
    struct place place = {0};

    if (!end)
        return wrong("%s: not field=value", change);
    if (!ddx_store_field(item, 0))
        return wrong("a type that only its programs know");
    if (!*ddx_store_field(item, 0)->name && !strncmp(change, "value=", 6))
        path = end; /* not a struct: the only field has no name */
    snprintf(asked, sizeof asked, "%.*s", (int)(end - change), change);
    const char *bad = find(item, path, end, &place);
    if (bad)
        return bad;
    char *to = apply ? (char *)data + place.offset : NULL;
    return place.field->kind == DDX_KIND_CHAR && place.count > 1 ? put_text(&place, to, end + 1)
                                                                 : put_numbers(&place, to, end + 1);
}
