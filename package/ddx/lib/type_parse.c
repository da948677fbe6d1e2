/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * A C declaration becomes a table of fields: enough of C's grammar for structs of numbers, characters, nested structs
 * and arrays. Sizes and alignments are those of the compiler that built this library, hence of the calling program's
 * ABI.
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "expression.h"
#include "type.h"

#define NESTING_MAX 8

struct parser {
    const char *at;
    struct ddx_layout *layout; /* room for DDX_FIELDS_MAX */
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

static void skip_space(struct parser *p) {
    while (isspace((unsigned char)*p->at))
        p->at++;
}

static bool accept(struct parser *p, char c) {
    skip_space(p);
    if (*p->at != c)
        return false;
    p->at++;
    return true;
}

/* The next word, copied; false if there is none or it is too long for a name. */
static bool word(struct parser *p, char name[DDX_NAME_MAX + 1]) {
    size_t length = 0;

    skip_space(p);
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

static int members(struct parser *p, const char *prefix, uint64_t start, struct base *base);

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
    return is_double && is_long ? -EINVAL : 0;
}

/* The fields of a type that this program declared by DDX_STORE_TYPE, as a nested struct. */
static int declared(struct parser *p, const char *name, const char *prefix, uint64_t start, struct base *base);

static int type(struct parser *p, const char *prefix, uint64_t start, struct base *base) {
    char name[DDX_NAME_MAX + 1];
    const char *first;

    do {
        skip_space(p);
        first = p->at;
        if (!word(p, name))
            return -EINVAL;
    } while (!strcmp(name, "const") || !strcmp(name, "volatile"));
    if (!strcmp(name, "struct")) {
        word(p, name); /* its tag, if any */
        if (accept(p, '{'))
            return members(p, prefix, start, base);
        p->bad = first;
        return -EINVAL;
    }
    for (size_t i = 0; i < sizeof named / sizeof named[0]; i++)
        if (!strcmp(name, named[i].name)) {
            *base = named[i].base;
            return 0;
        }
    int result = arithmetic(p, name, base);
    if (result == -EINVAL)
        result = declared(p, name, prefix, start, base);
    if (result == -EINVAL && !p->bad)
        p->bad = first;
    return result;
}

/* All of "[4][MAX/2]" after a name, as one count. */
static int bounds(struct parser *p, uint64_t *count) {
    *count = 1;
    while (accept(p, '[')) {
        int64_t bound;
        int result = ddx_expression(&p->at, &bound);

        if (result)
            return result;
        if (!accept(p, ']') || bound < 1 || (uint64_t)bound > DDX_SIZE_MAX / *count)
            return -EINVAL;
        *count *= (uint64_t)bound;
    }
    return 0;
}

static int add(struct parser *p, struct ddx_layout_field **field) {
    if (p->layout->field_count == DDX_FIELDS_MAX)
        return -EINVAL;
    *field = &p->layout->field[p->layout->field_count++];
    memset(*field, 0, sizeof **field);
    return 0;
}

static int full_name(char out[DDX_NAME_MAX + 1], const char *prefix, const char *name) {
    if (strlen(prefix) + strlen(name) + 1 > DDX_NAME_MAX)
        return -EINVAL;
    strcpy(out, prefix);
    if (*prefix)
        strcat(out, ".");
    strcat(out, name);
    return 0;
}

/*
 * The declarators of one line: "a, b[3];". The type's nested fields, if any, were parsed before its first name was
 * known, so they are parsed again for each name: `line` is where the type begins.
 */
static int declarators(struct parser *p, const char *line, const char *prefix, uint64_t start, uint64_t *end,
                       unsigned *alignment) {
    for (bool first = true;; first = false) {
        char name[DDX_NAME_MAX + 1], path[DDX_NAME_MAX + 1];
        struct base base;
        unsigned here = p->layout->field_count;
        const char *resume = p->at;

        /* Get kind and size, then drop the nested fields until name and offset are known. */
        p->at = line;
        int result = type(p, "", 0, &base);
        p->layout->field_count = here;
        if (result)
            return result;
        if (!first)
            p->at = resume;
        if (!word(p, name) || (result = full_name(path, prefix, name)))
            return -EINVAL; /* a pointer, a bit field without a name, ... */
        uint64_t count;
        if ((result = bounds(p, &count)))
            return result;
        resume = p->at;

        uint64_t offset = (*end + base.alignment - 1) / base.alignment * base.alignment;
        struct ddx_layout_field *field;
        if (count > DDX_SIZE_MAX / base.bytes || (result = add(p, &field)))
            return -EINVAL;
        strcpy(field->name, path);
        field->kind = (uint8_t)base.kind;
        field->bytes = (uint32_t)base.bytes;
        field->count = (uint32_t)count;
        field->offset = start + offset;
        field->used = base.bytes * count;
        if (base.kind == DDX_KIND_STRUCT) {
            p->at = line;
            if ((result = type(p, path, start + offset, &base)))
                return result;
            field->children = (uint16_t)(p->layout->field_count - here - 1);
            p->at = resume;
        }
        *end = offset + base.bytes * count;
        if (*end > DDX_SIZE_MAX)
            return -EINVAL;
        if (base.alignment > *alignment)
            *alignment = base.alignment;
        if (accept(p, ';'))
            return 0;
        if (!accept(p, ','))
            return -EINVAL; /* a bit field, an attribute, ... */
    }
}

/* After "struct {": all lines up to "}". */
static int members(struct parser *p, const char *prefix, uint64_t start, struct base *base) {
    uint64_t end = 0;
    unsigned alignment = 1;

    if (++p->depth > NESTING_MAX)
        return -EINVAL;
    while (!accept(p, '}')) {
        int result = declarators(p, p->at, prefix, start, &end, &alignment);

        if (result)
            return result;
    }
    p->depth--;
    if (end == 0)
        return -EINVAL;
    *base = (struct base){DDX_KIND_STRUCT, (end + alignment - 1) / alignment * alignment, alignment};
    return 0;
}

static struct ddx_type_declaration_ *declarations;

/* Runs from constructors, before main() and before threads. */
void ddx_type_declare_(struct ddx_type_declaration_ *declaration) {
    declaration->next = declarations;
    declarations = declaration;
}

static int declared(struct parser *p, const char *name, const char *prefix, uint64_t start, struct base *base) {
    for (const struct ddx_type_declaration_ *d = declarations; d; d = d->next)
        if (!strcmp(d->name, name)) {
            const char *resume = p->at;

            if (++p->depth > NESTING_MAX)
                return -EINVAL;
            p->at = d->text;
            int result = type(p, prefix, start, base);
            p->at = resume;
            p->depth--;
            return result;
        }
    return -EINVAL;
}

int ddx_layout_parse(const char *text, struct ddx_layout **layout) {
    const char *bad;

    return ddx_layout_parse_until(text, layout, &bad);
}

int ddx_layout_parse_until(const char *text, struct ddx_layout **layout, const char **bad) {
    struct parser p = {text, calloc(1, ddx_layout_bytes(DDX_FIELDS_MAX)), 0, NULL};
    struct base base;

    if (!p.layout)
        return -ENOMEM;
    int result = type(&p, "", 0, &base);
    skip_space(&p);
    if (!result && *p.at)
        result = -EINVAL;
    if (result) {
        *bad = p.bad ? p.bad : p.at;
        free(p.layout);
        return result;
    }
    p.layout->size = base.bytes;
    if (base.kind != DDX_KIND_STRUCT) {
        p.layout->field_count = 1;
        p.layout->field[0] = (struct ddx_layout_field){
            .kind = (uint8_t)base.kind, .bytes = (uint32_t)base.bytes, .count = 1, .used = base.bytes};
    }
    *layout = p.layout;
    return 0;
}

const struct ddx_type_declaration_ *ddx_type_declared(const char *name) {
    const struct ddx_type_declaration_ *d = declarations;

    while (d && strcmp(d->name, name))
        d = d->next;
    return d;
}

int ddx_layout_of(const char *name, struct ddx_layout **layout) {
    struct ddx_layout *found = NULL;

    for (const struct ddx_type_declaration_ *d = declarations; d; d = d->next) {
        struct ddx_layout *other;

        if (strcmp(d->name, name))
            continue;
        int result = ddx_layout_parse(d->text, &other);
        if (!result && other->size != d->size) { /* an attribute or a pragma that the text does not show */
            free(other);
            result = -EINVAL;
        }
        if (!result && found && !ddx_layout_same(found, other)) {
            free(other);
            result = -EPROTOTYPE;
        }
        if (result) {
            free(found);
            return result;
        }
        free(found);
        found = other;
    }
    if (found) {
        *layout = found;
        return 0;
    }
    return ddx_layout_parse(name, layout) ? -ENOENT : 0;
}

/* ---- Problems of a declaration ---- */

/* The reason why a type cannot be shared, in a line that names the word at fault. */

#define WORD_MAX 80

/* Length of a word such as "std::int32_t". */
static size_t word_length(const char *at) {
    size_t length = 0;

    while (isalnum((unsigned char)at[length]) || at[length] == '_' || at[length] == ':')
        length++;
    return length;
}

/* The word at `at`, with the next word if it has no meaning alone: "enum colour", "* pointer", ": 3". */
static void copy_word(char word[WORD_MAX], const char *at) {
    static const char *const openers[] = {"enum", "struct", "union", "long", "unsigned", "signed"};
    bool is_mark = *at && !isalnum((unsigned char)*at) && *at != '_';
    size_t length = is_mark ? 1 : word_length(at);
    bool opens = is_mark;

    for (size_t i = 0; i < sizeof openers / sizeof *openers; i++)
        opens |= length == strlen(openers[i]) && !strncmp(at, openers[i], length);
    if (opens) {
        size_t space = strspn(at + length, " \t\n");
        size_t next = word_length(at + length + space);

        length += next ? space + next : 0;
    }
    snprintf(word, WORD_MAX, "%.*s", (int)(length < WORD_MAX ? length : WORD_MAX - 1), at);
}

int ddx_type_problem(const char *type, char *text, size_t bytes) {
    const struct ddx_type_declaration_ *declared = type ? ddx_type_declared(type) : NULL;
    struct ddx_layout *layout;
    const char *bad = "";
    char word[WORD_MAX];

    if (!type || !text || !bytes)
        return -EINVAL;
    *text = 0;
    int result = ddx_layout_parse_until(declared ? declared->text : type, &layout, &bad);
    if (result == -EINVAL) {
        copy_word(word, bad);
        if (*word)
            snprintf(text, bytes,
                     "`%s` cannot be in a type that is shared: only C's integers, float, double, char, fixed arrays, "
                     "and structs of these that are declared in place or by DDX_STORE_TYPE",
                     word);
        else
            snprintf(text, bytes, "the declaration of the type is not complete");
    }
    if (result)
        return result;
    uint64_t size = layout->size;
    free(layout);
    if (!declared || declared->size == size)
        return 0;
    snprintf(text, bytes, "%s has %zu bytes where its fields need %llu: an attribute or a pragma changes its layout",
             type, declared->size, (unsigned long long)size);
    return -EINVAL;
}
