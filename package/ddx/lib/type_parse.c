/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * A C declaration becomes a table of fields: enough of C's grammar for structs of numbers, characters, nested structs
 * and arrays. Sizes and alignments are those of the compiler that built this library, hence of the calling program's
 * ABI.
 */
#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "type.h"

/* ---- Constant integer expressions, as in array bounds after the preprocessor: "(1920*1080)/4" ---- */

#define DEPTH_MAX 32

/* Binary operators, the tightest last. */
static const struct {
    char sign[3];
    int level;
} operators[] = {{"|", 1}, {"^", 2}, {"&", 3}, {"<<", 4}, {">>", 4}, {"+", 5}, {"-", 5}, {"*", 6}, {"/", 6}, {"%", 6}};

static int binary(const char **text, int level, int depth, int64_t *value);

static void skip_space(const char **text) {
    while (isspace((unsigned char)**text))
        (*text)++;
}

static int primary(const char **text, int depth, int64_t *value) {
    skip_space(text);
    if (depth > DEPTH_MAX)
        return -EINVAL;
    char c = **text;
    if (c == '(') {
        (*text)++;
        int result = binary(text, 1, depth + 1, value);
        skip_space(text);
        if (result || **text != ')')
            return -EINVAL;
        (*text)++;
        return 0;
    }
    if (c == '-' || c == '+' || c == '~') {
        (*text)++;
        int result = primary(text, depth + 1, value);
        if (!result && c == '-' && __builtin_sub_overflow((int64_t)0, *value, value))
            return -EINVAL;
        if (c == '~')
            *value = ~*value;
        return result;
    }
    if (!isdigit((unsigned char)c))
        return -EINVAL;
    char *end;
    errno = 0;
    *value = strtoll(*text, &end, 0);
    if (errno)
        return -EINVAL;
    while (*end && strchr("uUlL", *end))
        end++;
    *text = end;
    return 0;
}

static int apply(const char *sign, int64_t *left, int64_t right) {
    bool shift_ok = right >= 0 && right < 62 && *left >= 0;

    switch (*sign) {
    case '|': *left |= right; return 0;
    case '^': *left ^= right; return 0;
    case '&': *left &= right; return 0;
    case '<':
        if (!shift_ok || *left > INT64_MAX >> right)
            return -EINVAL;
        *left <<= right;
        return 0;
    case '>':
        if (!shift_ok)
            return -EINVAL;
        *left >>= right;
        return 0;
    case '+': return __builtin_add_overflow(*left, right, left) ? -EINVAL : 0;
    case '-': return __builtin_sub_overflow(*left, right, left) ? -EINVAL : 0;
    case '*': return __builtin_mul_overflow(*left, right, left) ? -EINVAL : 0;
    default: break;
    }
    if (right == 0 || (right == -1 && *left == INT64_MIN))
        return -EINVAL;
    *left = *sign == '/' ? *left / right : *left % right;
    return 0;
}

static int binary(const char **text, int level, int depth, int64_t *value) {
    int result = primary(text, depth, value);

    while (!result) {
        size_t i = 0, count = sizeof operators / sizeof operators[0];

        skip_space(text);
        while (i < count && strncmp(*text, operators[i].sign, strlen(operators[i].sign)) != 0)
            i++;
        if (i == count || operators[i].level < level)
            return 0;
        *text += strlen(operators[i].sign);
        int64_t right;
        result = binary(text, operators[i].level + 1, depth + 1, &right);
        if (!result)
            result = apply(operators[i].sign, value, right);
    }
    return result;
}

/* Evaluate the expression at *text and move *text after it. -EINVAL: not understood, overflow, division by zero. */
static int expression(const char **text, int64_t *value) {
    return binary(text, 1, 0, value);
}

/* ---- Types ---- */

#define NESTING_MAX 8

struct parser {
    const char *at;
    /* Room for DDX_FIELDS_MAX. While parsing, name and offset of a nested field are those within its struct. */
    struct ddx_layout *layout;
    const struct ddx_type_declaration_ *known; /* types that the text may name */
    bool portable;                             /* only types that are the same on all machines */
    int depth;
    const char *bad; /* the word that is not a type; NULL: the parser stopped at `at` */
};

/* The type before a declarator. */
struct base {
    enum ddx_kind kind;
    uint64_t bytes;
    unsigned alignment;
};

#define ALIGNMENT(type)  \
    offsetof(            \
        struct {         \
            char before; \
            type it;     \
        },               \
        it)
#define BASE(kind, type) \
    { DDX_KIND_##kind, sizeof(type), ALIGNMENT(type) }

static const struct {
    const char *name;
    struct base base;
} named[] = {
    {"int8_t", BASE(INT, int8_t)},      {"uint8_t", BASE(UNSIGNED, uint8_t)},
    {"int16_t", BASE(INT, int16_t)},    {"uint16_t", BASE(UNSIGNED, uint16_t)},
    {"int32_t", BASE(INT, int32_t)},    {"uint32_t", BASE(UNSIGNED, uint32_t)},
    {"int64_t", BASE(INT, int64_t)},    {"uint64_t", BASE(UNSIGNED, uint64_t)},
    {"size_t", BASE(UNSIGNED, size_t)}, {"DDX_TIME", BASE(INT, DDX_TIME)},
    {"_Bool", BASE(UNSIGNED, _Bool)},   {"bool", BASE(UNSIGNED, _Bool)},
    {"float", BASE(FLOAT, float)},
};

static bool accept(struct parser *p, char c) {
    skip_space(&p->at);
    if (*p->at != c)
        return false;
    p->at++;
    return true;
}

/* The next word, copied; false if there is none or it is too long for a name. */
static bool word(struct parser *p, char name[DDX_NAME_MAX + 1]) {
    size_t length = 0;

    skip_space(&p->at);
    if (!isalpha((unsigned char)*p->at) && *p->at != '_')
        return false;
    while (isalnum((unsigned char)p->at[length]) || p->at[length] == '_')
        length++;
    if (length > DDX_NAME_MAX)
        return false;
    memcpy(name, p->at, length);
    name[length] = 0;
    p->at += length;
    return true;
}

static int members(struct parser *p, struct base *base);

/* "unsigned long long", "char", ...: count the words, then derive the type from the counts. */
static int arithmetic(struct parser *p, const char *first, struct base *base) {
    unsigned is_signed = 0, is_unsigned = 0, is_char = 0, is_short = 0, is_int = 0, is_long = 0, is_double = 0;
    char name[DDX_NAME_MAX + 1];
    const char *before = p->at;

    strcpy(name, first);
    do {
        if (!strcmp(name, "signed"))
            is_signed++;
        else if (!strcmp(name, "unsigned"))
            is_unsigned++;
        else if (!strcmp(name, "char"))
            is_char++;
        else if (!strcmp(name, "short"))
            is_short++;
        else if (!strcmp(name, "int"))
            is_int++;
        else if (!strcmp(name, "long"))
            is_long++;
        else if (!strcmp(name, "double"))
            is_double++;
        else if (strcmp(name, "const") && strcmp(name, "volatile")) {
            p->at = before; /* the declared name */
            break;
        }
        before = p->at;
    } while (word(p, name));
    if (is_double)
        /* long double differs between i386 and x86_64, and cannot be shared */
        *base = (struct base)BASE(FLOAT, double);
    else if (is_char && (is_signed || is_unsigned))
        *base = is_unsigned ? (struct base)BASE(UNSIGNED, char) : (struct base)BASE(INT, char);
    else if (is_char)
        *base = (struct base)BASE(CHAR, char);
    else if (is_short)
        *base = (struct base)BASE(INT, short);
    else if (is_long == 1)
        *base = (struct base)BASE(INT, long);
    else if (is_long == 2)
        *base = (struct base)BASE(INT, long long);
    else if (is_int || is_signed || is_unsigned)
        *base = (struct base)BASE(INT, int);
    else
        return -EINVAL;
    if (is_unsigned)
        base->kind = DDX_KIND_UNSIGNED;
    return is_long && (is_double || (p->portable && is_long == 1)) ? -EINVAL : 0;
}

static int declared(struct parser *p, const char *name, struct base *base);

static int type(struct parser *p, struct base *base) {
    char name[DDX_NAME_MAX + 1];
    const char *first;

    do {
        skip_space(&p->at);
        first = p->at;
        if (!word(p, name))
            return -EINVAL;
    } while (!strcmp(name, "const") || !strcmp(name, "volatile"));
    if (!strcmp(name, "struct")) {
        word(p, name); /* its tag, if any */
        if (accept(p, '{'))
            return members(p, base);
        p->bad = first;
        return -EINVAL;
    }
    for (size_t i = 0; i < sizeof named / sizeof named[0]; i++)
        if (!strcmp(name, named[i].name) && !(p->portable && !strcmp(name, "size_t"))) {
            *base = named[i].base;
            return 0;
        }
    int result = arithmetic(p, name, base);
    if (result == -EINVAL)
        result = declared(p, name, base);
    if (result == -EINVAL && !p->bad)
        p->bad = first;
    return result;
}

/* All of "[4][MAX/2]" after a name, as one count. */
static int bounds(struct parser *p, uint64_t *count) {
    *count = 1;
    while (accept(p, '[')) {
        int64_t bound;
        int result = expression(&p->at, &bound);

        if (result)
            return result;
        if (!accept(p, ']') || bound < 1 || (uint64_t)bound > DDX_SIZE_MAX / *count)
            return -EINVAL;
        *count *= (uint64_t)bound;
    }
    return 0;
}

static int add(struct parser *p, unsigned count) {
    if (p->layout->field_count + count > DDX_FIELDS_MAX)
        return -EINVAL;
    p->layout->field_count += count;
    return 0;
}

/* The declarators of one line: "a, b[3];". Each gets a field and a copy of the type's nested fields. */
static int declarators(struct parser *p, uint64_t *end, unsigned *alignment) {
    unsigned first = p->layout->field_count;
    struct base base;
    int result = add(p, 1);

    if (!result)
        result = type(p, &base);
    if (result)
        return result;
    unsigned fields = p->layout->field_count - first;
    for (struct ddx_layout_field *field = &p->layout->field[first];; field += fields) {
        uint64_t count;

        memset(field, 0, sizeof *field);
        if (!word(p, field->name))
            return -EINVAL; /* a pointer, a bit field without a name, ... */
        if ((result = bounds(p, &count)))
            return result;
        uint64_t offset = (*end + base.alignment - 1) / base.alignment * base.alignment;
        if (count > DDX_SIZE_MAX / base.bytes)
            return -EINVAL;
        field->kind = (uint8_t)base.kind;
        field->bytes = (uint32_t)base.bytes;
        field->count = (uint32_t)count;
        field->children = (uint16_t)(fields - 1);
        field->offset = offset;
        field->used = base.bytes * count;
        *end = offset + field->used;
        if (*end > DDX_SIZE_MAX)
            return -EINVAL;
        if (base.alignment > *alignment)
            *alignment = base.alignment;
        if (accept(p, ';'))
            return 0;
        if (!accept(p, ',')) /* a bit field, an attribute, ... */
            return -EINVAL;
        if ((result = add(p, fields)))
            return result;
        memcpy(field + fields, field, fields * sizeof *field);
    }
}

/* After "struct {": all lines up to "}". */
static int members(struct parser *p, struct base *base) {
    uint64_t end = 0;
    unsigned alignment = 1;

    if (++p->depth > NESTING_MAX)
        return -EINVAL;
    while (!accept(p, '}')) {
        int result = declarators(p, &end, &alignment);

        if (result)
            return result;
    }
    p->depth--;
    if (end == 0)
        return -EINVAL;
    *base = (struct base){DDX_KIND_STRUCT, (end + alignment - 1) / alignment * alignment, alignment};
    return 0;
}

/* The fields of a known type, as a nested struct. */
static int declared(struct parser *p, const char *name, struct base *base) {
    for (const struct ddx_type_declaration_ *d = p->known; d; d = d->next)
        if (!strcmp(d->name, name)) {
            const char *resume = p->at;

            if (++p->depth > NESTING_MAX)
                return -EINVAL;
            p->at = d->text;
            int result = type(p, base);
            p->at = resume;
            p->depth--;
            return result;
        }
    return -EINVAL;
}

/* Give all fields from `first` up to `end` their full names and offsets in the item. */
static int resolve(struct ddx_layout *layout, unsigned first, unsigned end, const char *prefix, uint64_t start) {
    for (unsigned i = first; i < end; i = ddx_layout_after(layout, i)) {
        struct ddx_layout_field *field = &layout->field[i];
        size_t before = strlen(prefix), length = strlen(field->name);

        if (before + length > DDX_NAME_MAX)
            return -EINVAL;
        memmove(field->name + before, field->name, length + 1);
        memcpy(field->name, prefix, before);
        field->offset += start;
        if (field->children) {
            char inner[DDX_NAME_MAX + 2];

            snprintf(inner, sizeof inner, "%s.", field->name);
            int error = resolve(layout, i + 1, ddx_layout_after(layout, i), inner, field->offset);
            if (error)
                return error;
        }
    }
    return 0;
}

static int parse(struct parser *p, struct ddx_layout **layout) {
    const char *text = p->at;
    struct base base;

    p->layout = calloc(1, ddx_layout_bytes(DDX_FIELDS_MAX));
    if (!p->layout)
        return -ENOMEM;
    int result = type(p, &base);
    skip_space(&p->at);
    if (!result && *p->at)
        result = -EINVAL;
    if (!result && (result = resolve(p->layout, 0, p->layout->field_count, "", 0)))
        p->bad = text;
    if (result) {
        free(p->layout);
        return result;
    }
    p->layout->size = base.bytes;
    if (base.kind != DDX_KIND_STRUCT) {
        p->layout->field_count = 1;
        p->layout->field[0] = (struct ddx_layout_field){
            .kind = (uint8_t)base.kind, .bytes = (uint32_t)base.bytes, .count = 1, .used = base.bytes};
    }
    *layout = p->layout;
    return 0;
}

int ddx_layout_parse_known(const char *text, const struct ddx_type_declaration_ *known, struct ddx_layout **layout,
                           const char **bad) {
    struct parser parser = {.at = text, .known = known};
    int result = parse(&parser, layout);

    if (result)
        *bad = parser.bad ? parser.bad : parser.at;
    return result;
}

int ddx_layout_parse_portable(const char *text, struct ddx_layout **layout) {
    struct parser parser = {.at = text, .portable = true};

    return parse(&parser, layout);
}
