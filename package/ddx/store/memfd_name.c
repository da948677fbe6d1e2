/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A memory file's name states its purpose, and its owner the user that made it; no holder of the file can change
 * either. So after a restart the store recognizes the files of the former store, accepts no others, and accepts each
 * only for its item, epoch, layout and slot.
 */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "memfd_name.h"

uint64_t memfd_name_digest(const struct ddx_layout *layout) { /* FNV-1a */
    const unsigned char *byte = (const unsigned char *)layout;
    uint64_t sum = 0xcbf29ce484222325u;

    for (size_t i = 0; i < ddx_layout_bytes(layout->field_count); i++)
        sum = (sum ^ byte[i]) * 0x100000001b3u;
    return sum;
}

const char *memfd_name_of(const char *item, const char *what) {
    static char label[MEMFD_NAME_MAX];

    snprintf(label, sizeof label, "%s %s", item, what);
    return label;
}

const char *memfd_name_of_slot(const char *item, const struct epoch *epoch, unsigned slot) {
    static char label[MEMFD_NAME_MAX];
    int length = snprintf(label, sizeof label, "%s %u %016llx ", item, epoch->number,
                          (unsigned long long)epoch->digest);

    if (slot == DDX_NO_SLOT)
        strcpy(label + length, "control");
    else
        snprintf(label + length, sizeof label - (size_t)length, "frame %u", slot);
    return label;
}

bool memfd_name_is(int fd, const char *label) {
    char path[32], wanted[MEMFD_NAME_MAX + 32], found[MEMFD_NAME_MAX + 32];
    struct stat status;

    if (fd < 0 || fstat(fd, &status) || status.st_uid != geteuid())
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    int length = snprintf(wanted, sizeof wanted, "/memfd:%s (deleted)", label);
    return readlink(path, found, sizeof found) == length && !memcmp(wanted, found, (size_t)length);
}
