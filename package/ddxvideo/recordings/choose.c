/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "choose.h"

#include <stdlib.h>
#include <string.h>

#include "show.h"

static bool is_meant(const struct found *first, const char *word) {
    char name[NAME_MAX + 1], *end;

    show_name(first, name);
    unsigned long number = strtoul(word, &end, 10);
    return !strcmp(word, name) || (end != word && !*end && number && number == first->session);
}

bool choose_files(const struct folder *folder, const char *word, bool *chosen) {
    bool any = false, all = !strcmp(word, "all"), newest = !strcmp(word, "newest");

    for (unsigned i = 0, count; i < folder->count; i += count) {
        count = show_count(folder, i);
        bool whole = all || (newest && i + count == folder->count) || is_meant(&folder->file[i], word);
        for (unsigned k = i; k < i + count; k++)
            if (whole || !strcmp(folder->file[k].name, word))
                any = chosen[k] = true;
    }
    return any;
}
