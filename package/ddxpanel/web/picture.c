/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "picture.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "scgi.h"

#define DEFAULT_QUALITY 6

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

    if (!name_parse(wanted->item, sizeof wanted->item, text, size))
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
