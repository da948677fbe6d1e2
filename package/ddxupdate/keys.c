/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "keys.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>

#include "place.h"

unsigned keys_read(const char *folder, struct update_key keys[KEYS_MAX]) {
    DIR *names = opendir(folder);
    unsigned count = 0;

    for (const struct dirent *entry; names && count < KEYS_MAX && (entry = readdir(names));) {
        char path[PATH_MAX + NAME_MAX], text[KEY_FILE_MAX];
        if (entry->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        FILE *file = fopen(path, "re");
        const size_t size = file ? fread(text, 1, sizeof text, file) : 0;
        if (key_parse(text, size, &keys[count]))
            count++;
        else
            fail(0, "%s: no key of minisign's; it is left out", path);
        if (file)
            fclose(file);
    }
    if (names)
        closedir(names);
    return count;
}
