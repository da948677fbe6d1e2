/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The types that this program declares by DDX_STORE_TYPE, and the reason why one of them cannot be shared. */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "type.h"

static struct ddx_type_declaration_ *declarations;

/* Runs from constructors, before main() and before threads. */
void ddx_type_declare_(struct ddx_type_declaration_ *declaration) {
    declaration->next = declarations;
    declarations = declaration;
}

int ddx_layout_parse(const char *text, struct ddx_layout **layout) {
    const char *bad;

    return ddx_layout_parse_known(text, declarations, layout, &bad);
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
    int result = ddx_layout_parse_known(declared ? declared->text : type, declarations, &layout, &bad);
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
