/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "picture.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define DEFAULT_QUALITY 6

/* The value of a hexadecimal digit; -1: it is none. */
static int digit(char c) {
    static const char digits[] = "0123456789abcdef0123456789ABCDEF";
    const char *at = c ? strchr(digits, c) : NULL;

    return at ? (int)(at - digits) % 16 : -1;
}

/* Whether the first `size` bytes are an item's name, with %XX; writes the name. */
static bool take_item(char item[PICTURE_ITEM + 1], const char *text, size_t size) {
    size_t length = 0;

    for (const char *at = text; at < text + size; at++) {
        int c = (unsigned char)*at;

        if (c == '%') {
            int high = at + 2 < text + size ? digit(at[1]) : -1, low = high < 0 ? -1 : digit(at[2]);
            if (low < 0)
                return false;
            c = 16 * high + low;
            at += 2;
        }
        if (c <= ' ' || c > '~' || c == '/' || length == PICTURE_ITEM)
            return false;
        item[length++] = (char)c;
    }
    item[length] = 0;
    return length > 0;
}

/* A number without sign, from `least` to `most`, that ends at '&' or with the text. */
static bool take_number(uint64_t *value, const char *text, uint64_t least, uint64_t most) {
    char *end;

    errno = 0;
    *value = strtoull(text, &end, 10);
    return !errno && *text >= '0' && *text <= '9' && (!*end || *end == '&') && *value >= least && *value <= most;
}

bool picture_parse(struct picture_wanted *wanted, const char *text) {
    size_t size = strcspn(text, "?");
    uint64_t after = 0, quality = DEFAULT_QUALITY, divisor = 1;
    const struct {
        const char *name;
        uint64_t *value, least, most;
    } words[] = {{"after=", &after, 0, INT64_MAX},
                 {"quality=", &quality, PICTURE_BEST, PICTURE_SMALLEST},
                 {"divisor=", &divisor, 1, 2}};

    if (!take_item(wanted->item, text, size))
        return false;
    text += size;
    while (*text) {
        bool good = false;

        text++; /* '?' or '&' */
        for (size_t i = 0; i < sizeof words / sizeof words[0] && !good; i++) {
            size_t length = strlen(words[i].name);

            good = !strncmp(text, words[i].name, length) &&
                   take_number(words[i].value, text + length, words[i].least, words[i].most);
        }
        if (!good)
            return false;
        text += strcspn(text, "&");
    }
    wanted->after = after;
    wanted->form = (struct picture_form){(int)quality, (int)divisor};
    return true;
}

/* A number of the line; *at moves behind it and the blank after it. */
static bool next_number(const char **at, int64_t *value) {
    char *end;

    errno = 0;
    *value = strtoll(*at, &end, 10);
    bool good = !errno && end > *at && (!*end || *end == ' ');
    *at = *end ? end + 1 : end;
    return good;
}

bool picture_hear(struct picture_said *said, const char *line) {
    static const char picture[] = "picture ", refused[] = "refused ";

    *said = (struct picture_said){.kind = PICTURE_NOTHING};
    if (!strcmp(line, "nothing"))
        return true;
    if (!strncmp(line, refused, strlen(refused))) {
        said->kind = PICTURE_REFUSED;
        said->reason = line + strlen(refused);
        return true;
    }
    if (strncmp(line, picture, strlen(picture)) != 0)
        return false;
    int64_t sequence, size;
    const char *at = line + strlen(picture);
    if (!next_number(&at, &sequence) || !next_number(&at, &said->frame) || !next_number(&at, &said->age) ||
        !next_number(&at, &said->lost) || !next_number(&at, &size) || *at)
        return false;
    said->sequence = (uint64_t)sequence;
    said->size = (size_t)size;
    said->kind = size <= (int64_t)PICTURE_MAX ? PICTURE_NEW : PICTURE_TOO_LARGE;
    said->reason = "the picture is too large at this quality";
    return sequence > 0 && size > 0;
}
