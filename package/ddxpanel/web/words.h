/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The words of an order: the body of a request, a word a line. */
#ifndef DDXPANEL_WORDS_H
#define DDXPANEL_WORDS_H

#include <stddef.h>

#define WORDS_MAX 16     /* words of an order */
#define WORDS_SIZE 1024u /* bytes of all words, with a 0 byte each */

struct words {
    unsigned count;
    size_t size;
    char text[WORDS_SIZE];           /* the words, each with its 0 byte */
    const char *word[WORDS_MAX + 1]; /* into `text`; NULL after the last */
};

/*
 * Split a text into its lines; the last one needs no line feed. 0; -EINVAL: no word, an empty one, or one that has
 * other characters than those from ' ' to '~'; -E2BIG: too many, or too long.
 */
int words_split(struct words *words, const char *text, size_t size);

#endif
