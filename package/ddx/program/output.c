/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "output.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "program.h"

#define TRIES 100

/* The folder of a file. */
static void parent(const char *path, char *folder) {
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) : 0;

    if (!slash)
        strcpy(folder, ".");
    else if (!length)
        strcpy(folder, "/");
    else
        snprintf(folder, PATH_MAX, "%.*s", (int)length, path);
}

int output_check(struct output *output, const char *place, const char *name, const char *extension) {
    struct stat status;
    char folder[PATH_MAX];

    *output = (struct output){.place = place, .name = name, .extension = extension};
    if (strlen(place) >= PATH_MAX)
        return -ENAMETOOLONG;
    if (!strcmp(place, "-"))
        return 0;
    if (!stat(place, &status)) {
        output->is_folder = S_ISDIR(status.st_mode);
        return access(place, output->is_folder ? W_OK | X_OK : W_OK) ? -errno : 0;
    }
    if (errno != ENOENT)
        return -errno;
    if (place[strlen(place) - 1] == '/')
        return -ENOENT;
    parent(place, folder);
    return access(folder, W_OK | X_OK) ? -errno : 0;
}

/* Beginning of the file names, without the slashes of the item's name. */
static void file_prefix(const struct output *output, char *prefix, size_t size) {
    snprintf(prefix, size, "%s-", output->name);
    for (char *c = prefix; *c; c++)
        if (*c == '/')
            *c = '_';
}

/* The number after the prefix; 0 if the name has another form. */
static long number_of(const char *name, const char *prefix) {
    char *end;
    size_t length = strlen(prefix);

    if (strncmp(name, prefix, length) || name[length] < '0' || name[length] > '9')
        return 0;
    long number = strtol(name + length, &end, 10);
    return *end == '-' && number < LONG_MAX - TRIES ? number : 0;
}

long output_number(const struct output *output, const char *name) {
    char prefix[80];
    const char *end = strrchr(name, '.');

    file_prefix(output, prefix, sizeof prefix);
    return end && !strcmp(end + 1, output->extension) ? number_of(name, prefix) : 0;
}

void output_folder(const struct output *output, char *folder) {
    if (output->is_folder)
        snprintf(folder, PATH_MAX, "%s", output->place);
    else
        parent(output->place, folder);
}

int output_sync(const struct output *output) {
    char folder[PATH_MAX];

    output_folder(output, folder);
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int error = fd >= 0 && fsync(fd) && errno == EIO ? -EIO : 0;
    if (fd >= 0)
        close(fd);
    return error;
}

/* The highest number in use in the folder, or -errno. */
static long highest_number(const struct output *output, const char *prefix) {
    DIR *folder = opendir(output->place);

    if (!folder)
        return -errno;
    long highest = 0;
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        long number = number_of(entry->d_name, prefix);

        if (number > highest)
            highest = number;
    }
    closedir(folder);
    return highest;
}

/* Open a pipe for writing; a reader may open its other end later. */
static int open_pipe(const char *path) {
    const struct timespec step = {0, 20000000};

    for (;;) {
        int fd = open(path, O_WRONLY | O_CLOEXEC | O_NONBLOCK);

        if (fd >= 0 || (errno != ENXIO && errno != EINTR))
            return fd < 0 ? -errno : fd;
        if (program_has_no_patience())
            return -ECANCELED;
        nanosleep(&step, NULL);
    }
}

/* Standard output, reopened so that O_NONBLOCK does not apply to other programs that share it. */
static int open_standard(char *path) {
    struct stat status;
    bool regular = !fstat(STDOUT_FILENO, &status) && S_ISREG(status.st_mode);
    int fd = regular ? -1 : open("/proc/self/fd/1", O_WRONLY | O_CLOEXEC | O_NONBLOCK);

    if (fd < 0)
        fd = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
    strcpy(path, "standard output");
    return fd < 0 ? -errno : fd;
}

/* Lock the file for this process while it is open; file systems without locks are accepted. */
static int lock(int fd) {
    if (!flock(fd, LOCK_EX | LOCK_NB) || errno != EWOULDBLOCK)
        return fd;
    close(fd);
    return -EWOULDBLOCK;
}

/* Open the first of FILE, FILE-2, ... that does not exist or is empty. */
static int open_free(const struct output *output, char *path) {
    const char *slash = strrchr(output->place, '/'), *dot = strrchr(slash ? slash : output->place, '.');
    size_t stem = dot ? (size_t)(dot - output->place) : strlen(output->place);
    struct stat status;

    for (int number = 1; number < 10000; number++) {
        if (number == 1)
            snprintf(path, PATH_MAX, "%s", output->place);
        else if (snprintf(path, PATH_MAX, "%.*s-%d%s", (int)stem, output->place, number, dot ? dot : "") >= PATH_MAX)
            return -ENAMETOOLONG;
        if (!stat(path, &status) && status.st_size > 0)
            continue;
        int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0664);
        if (fd < 0)
            return -errno;
        fd = lock(fd);
        if (fd != -EWOULDBLOCK)
            return fd;
    }
    return -EEXIST;
}

static int open_named(const struct output *output, char *path) {
    struct stat status;

    if (!strcmp(output->place, "-"))
        return open_standard(path);
    snprintf(path, PATH_MAX, "%s", output->place);
    if (!stat(path, &status) && !S_ISREG(status.st_mode))
        return open_pipe(path);
    if (output->keep)
        return open_free(output, path);
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0664);
    if (fd < 0)
        return -errno;
    fd = lock(fd); /* before its content is truncated */
    if (fd >= 0 && ftruncate(fd, 0)) {
        int error = errno;

        close(fd);
        return -error;
    }
    return fd;
}

int output_open(const struct output *output, char *path) {
    if (!output->is_folder)
        return open_named(output, path);
    char prefix[80], stamp[32];
    file_prefix(output, prefix, sizeof prefix);
    long number = highest_number(output, prefix);
    if (number < 0)
        return (int)number;
    for (int i = 1; i <= TRIES; i++) {
        time_t now = time(NULL);
        struct tm utc;

        strftime(stamp, sizeof stamp, "%Y%m%dT%H%M%SZ", gmtime_r(&now, &utc));
        if (snprintf(path, PATH_MAX, "%s/%s%06ld-%s.%s", output->place, prefix, number + i, stamp, output->extension) >=
            PATH_MAX)
            return -ENAMETOOLONG;
        int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0664);
        int error = fd < 0 ? -errno : lock(fd);
        if (error != -EEXIST && error != -EWOULDBLOCK)
            return error;
        if (fd >= 0) /* another user has locked it in between, which must not prevent recording */
            unlink(path);
    }
    return -EEXIST;
}

/* Size of all files of this output, and the name of the file with the lowest number, or "". */
static uint64_t look_at(const struct output *output, DIR *folder, char oldest[NAME_MAX + 1]) {
    char prefix[80];
    long lowest = LONG_MAX;
    uint64_t bytes = 0;
    struct stat status;

    file_prefix(output, prefix, sizeof prefix);
    *oldest = 0;
    rewinddir(folder);
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        const char *end = strrchr(entry->d_name, '.');
        long number = number_of(entry->d_name, prefix);

        if (!number || !end || strcmp(end + 1, output->extension) ||
            fstatat(dirfd(folder), entry->d_name, &status, AT_SYMLINK_NOFOLLOW) || !S_ISREG(status.st_mode))
            continue;
        bytes += (uint64_t)status.st_size;
        if (number < lowest) {
            lowest = number;
            strcpy(oldest, entry->d_name);
        }
    }
    return bytes;
}

int output_keep(const struct output *output, uint64_t most) {
    char name[NAME_MAX + 1];
    DIR *folder = opendir(output->place);
    int error = folder ? 0 : -errno;

    while (!error && look_at(output, folder, name) > most && *name) {
        if (unlinkat(dirfd(folder), name, 0))
            error = -errno;
        else
            say("%s/%s: deleted to make room", output->place, name);
    }
    if (folder)
        closedir(folder);
    return error;
}
