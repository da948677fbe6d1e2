/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "words.h"

#include <errno.h>
#include <string.h>

int words_split(struct words *words, const char *text, size_t size) {
    *words = (struct words){.count = 0};
    for (const char *end = text + size, *next; text < end; text = next) {
        const char *feed = memchr(text, '\n', (size_t)(end - text));
        size_t length = (size_t)((feed ? feed : end) - text);

        next = feed ? feed + 1 : end;
        if (!length)
            return -EINVAL;
        for (size_t i = 0; i < length; i++)
            if (text[i] < ' ' || text[i] > '~')
                return -EINVAL;
        if (words->count == WORDS_MAX || length >= WORDS_SIZE - words->size)
            return -E2BIG;
        words->word[words->count++] = memcpy(words->text + words->size, text, length);
        words->size += length + 1;
    }
    return words->count ? 0 : -EINVAL;
}
