/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "repair_plain.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "program.h"
#include "video_layout.h"
#include "y4m.h"

/* Its complete frames, and the bytes up to the end of the last one. -1: not a recording of ours. */
static int64_t count_frames(FILE *file, int64_t size, int64_t *whole) {
    struct y4m_header header;
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    int64_t frames = 0;

    *whole = 0;
    if (!fgets(line, sizeof line, file) || !strchr(line, '\n'))
        return 0;
    *strchr(line, '\n') = 0;
    if (!y4m_parse_header(line, Y4M_SAME, &header, error) || !y4m_is_plain(&header))
        return -1;
    const int64_t bytes = (int64_t)video_layout_bytes(&header.geometry);
    while (fgets(line, sizeof line, file) && strchr(line, '\n')) {
        if (strncmp(line, "FRAME", 5))
            return -1;
        int64_t end = ftello(file) + bytes;
        if (end > size || fseeko(file, end, SEEK_SET))
            break;
        *whole = end;
        frames++;
    }
    return frames;
}

/* Repairs a file that no recorder uses; `own`: it is certainly a recording. Returns its frames; -1: not a recording. */
static int64_t mend(const char *folder, int at, const char *name, bool own) {
    struct stat status;
    int64_t whole, frames = -1;
    int fd = openat(at, name, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    FILE *file = fd < 0 || flock(fd, LOCK_EX | LOCK_NB) || fstat(fd, &status) || !S_ISREG(status.st_mode)
                     ? NULL
                     : fdopen(fd, "r");

    if (!file) {
        if (fd >= 0)
            close(fd);
        return -1;
    }
    frames = count_frames(file, status.st_size, &whole);
    if (own && !frames && !unlinkat(at, name, 0))
        say("%s/%s: was left without a whole frame; removed", folder, name);
    else if (frames > 0 && whole < status.st_size && !ftruncate(fd, whole))
        say("%s/%s: was left within a frame; cut after its last whole one, it has %lld", folder, name,
            (long long)frames);
    fclose(file);
    return frames;
}

/* Finds the file that the counters name, or without counters the newest recording. False: there is none. */
static bool find(const struct output *output, DIR *list, const DDX_STATS *stats, char name[NAME_MAX + 1]) {
    struct stat status;
    long highest = 0;

    *name = 0;
    rewinddir(list);
    for (const struct dirent *entry = readdir(list); entry; entry = readdir(list)) {
        long number = output_number(output, entry->d_name);
        bool found = stats ? !fstatat(dirfd(list), entry->d_name, &status, AT_SYMLINK_NOFOLLOW) &&
                                 status.st_ino == stats->file_inode && status.st_dev == stats->file_device
                           : number > highest;

        if (!found)
            continue;
        strcpy(name, entry->d_name);
        highest = number;
        if (stats)
            return true;
    }
    return *name;
}

void repair_plain_files(const struct output *output, DDX_STATS_BOOK *book) {
    DDX_STATS stats;
    char folder[PATH_MAX], name[NAME_MAX + 1];
    uint64_t found = 0;

    output_folder(output, folder);
    ddx_stats_get(book, &stats);
    DIR *list = opendir(folder);
    if (list && stats.file_inode && find(output, list, &stats, name)) {
        int64_t frames = mend(folder, dirfd(list), name, true);
        uint64_t counted = stats.out - stats.file_out;

        if (frames > 0 && (uint64_t)frames > counted)
            found = (uint64_t)frames - counted;
    }
    if (list && output->is_folder && find(output, list, NULL, name))
        mend(folder, dirfd(list), name, false);
    if (list)
        closedir(list);
    ddx_stats_found(book, found);
}
