/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "release.h"

#include <limits.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include "place.h"

/* The value of a line NAME=VALUE or NAME="VALUE". */
static bool value_of(const char *line, const char *name, char value[RELEASE_WORD]) {
    const char *found = line_value(line, name);

    if (!found)
        return false;
    found += *found == '"';
    snprintf(value, RELEASE_WORD, "%.*s", (int)strcspn(found, "\"\n"), found);
    return true;
}

static void number_of(const char *line, const char *name, uint64_t *number) {
    char value[RELEASE_WORD];

    if (value_of(line, name, value))
        *number = strtoull(value, NULL, 10);
}

bool release_read(const char *path, struct release *release) {
    FILE *file = fopen(path, "re");
    char line[1024];

    *release = (struct release){0};
    while (file && fgets(line, sizeof line, file)) {
        value_of(line, "VARIANT_ID", release->board);
        value_of(line, "VERSION", release->version);
        number_of(line, "DDX_LAYOUT", &release->layout);
        number_of(line, "DDX_SERIAL", &release->serial);
        number_of(line, "DDX_OLDEST", &release->oldest);
    }
    if (file)
        fclose(file);
    return release->board[0] && release->version[0];
}

bool release_of_slot(const char *device, const char *folder, struct release *release) {
    char path[PATH_MAX];
    struct stat kernel;
    bool found = false;

    *release = (struct release){0};
    if (unshare(CLONE_NEWNS) || mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL))
        return false;
    mkdir(folder, 0700);
    if (!mount(device, folder, "squashfs", MS_RDONLY | MS_SILENT | MS_NOSUID | MS_NODEV | MS_NOEXEC, NULL)) {
        snprintf(path, sizeof path, "%s/boot/vmlinuz", folder);
        found = !lstat(path, &kernel) && S_ISREG(kernel.st_mode) && kernel.st_size;
        snprintf(path, sizeof path, "%s/usr/lib/os-release", folder);
        found = found && release_read(path, release);
        umount(folder);
    }
    rmdir(folder);
    return found;
}
