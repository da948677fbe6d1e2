/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The reason why a type cannot be shared, in a line that names the word at fault. */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "type.h"

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
