/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "actions.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "bytes.h"
#include "crc32c.h"
#include "pool_files.h"
#include "program.h"
#include "verify.h"

#define UNFINISHED ".part"
#define AHEAD (8u << 20) /* most bytes that wait in memory for a slow stick: memory is for frames */

struct copy {
    struct verify from;
    const struct found *found;
    int fd;
    uint32_t sum;
    uint64_t written, synced;
    int percent;     /* printed last */
    int write_error; /* 0: the source failed */
};

/* ---- Copy: one file ---- */

static void show_progress(struct copy *copy) {
    int percent = (int)(copy->written * 100 / copy->from.bytes);

    if (percent == copy->percent || !isatty(STDOUT_FILENO))
        return;
    copy->percent = percent;
    printf("\r%s: %d %%", copy->found->shown, percent);
    fflush(stdout);
}

/* Writes the bytes up to `until` to the medium, and waits for them. */
static int push(struct copy *copy, uint64_t until) {
    int flags = SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER;

    if (sync_file_range(copy->fd, (off_t)copy->synced, (off_t)(until - copy->synced), (unsigned)flags) &&
        errno != ESPIPE && errno != EINVAL)
        return -errno;
    copy->synced = until;
    return 0;
}

static int take(void *to, const unsigned char *bytes, size_t size) {
    struct copy *copy = to;

    verify_bytes(&copy->from, bytes, size);
    copy->sum = crc32c(copy->sum, bytes, size);
    copy->write_error = bytes_write(copy->fd, bytes, size);
    if (copy->write_error)
        return copy->write_error;
    copy->written += size;
    show_progress(copy);
    return copy->written - copy->synced < AHEAD ? 0 : (copy->write_error = push(copy, copy->written));
}

static int add_up(void *to, const unsigned char *bytes, size_t size) {
    uint32_t *sum = to;

    *sum = crc32c(*sum, bytes, size);
    return 0;
}

/* Opens the written file for reading. If the folder belongs to another user, that user can replace it by a link or a
 * pipe: root neither follows nor waits for them, and reads no other file. */
static int open_written(const struct copy *copy, int to, const char *name, bool *direct) {
    int flags = O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK;
    struct stat written, opened;
    int fd = openat(to, name, flags | O_DIRECT);

    *direct = fd >= 0;
    if (fd < 0 && errno == EINVAL)
        fd = openat(to, name, flags);
    if (fd < 0)
        return errno == ELOOP ? -EBADMSG : -errno;
    if (!fstat(copy->fd, &written) && !fstat(fd, &opened) && written.st_dev == opened.st_dev &&
        written.st_ino == opened.st_ino)
        return fd;
    close(fd);
    return -EBADMSG;
}

/* Compares the bytes on the medium, past the page cache. 0; -EBADMSG: they differ; -errno. */
static int read_back(const struct copy *copy, int to, const char *name) {
    uint32_t sum = 0;
    bool direct;
    int fd = open_written(copy, to, name, &direct);

    if (fd < 0)
        return fd;
    int error = bytes_read(fd, direct, copy->written, add_up, &sum);
    close(fd);
    return error ? error : sum == copy->sum ? 0 : -EBADMSG;
}

/* Writes the file with a temporary name. Always a new file: an existing one may be a pipe, or a link. */
static int write_file(struct copy *copy, int to, const char *name) {
    if (unlinkat(to, name, 0) && errno != ENOENT)
        return copy->write_error = -errno;
    copy->fd = openat(to, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
    if (copy->fd < 0)
        return copy->write_error = -errno;
    int error = bytes_read(copy->from.use.fd, copy->from.use.direct, copy->from.bytes, take, copy);
    if (!error && fsync(copy->fd))
        error = copy->write_error = -errno;
    posix_fadvise(copy->fd, 0, 0, POSIX_FADV_DONTNEED);
    if (!error)
        error = copy->write_error = read_back(copy, to, name);
    return error;
}

/* Gives the file its name. FAT keeps a file's size beside the name, but writes it only with the file: until then the
 * name stands for an empty file. If that fails, no file of that name is left. */
static int give_name(const struct copy *copy, int to, const char *from) {
    if (renameat(to, from, to, copy->found->name))
        return -errno;
    int error = fsync(copy->fd) || fsync(to) ? -errno : 0;
    if (error)
        unlinkat(to, copy->found->name, 0);
    return error;
}

static void tell(const struct copy *copy, const char *to, int error) {
    const char *why = error == -EBADMSG  ? "reads back as something else than was written; take another stick"
                      : error == -EINTR  ? "told to stop"
                      : error == -ENOSPC ? "is full"
                      : error == -EFBIG  ? "takes no file of this size; format the stick as exFAT"
                      : error == -EINVAL ? "does not take this name"
                                         : strerror(-error);

    if (error == -EINTR)
        say("%s: not exported, %s", copy->found->shown, why);
    else if (error == -EBUSY && !copy->write_error)
        say("%s: not exported, it was given up for a new recording while it was read", copy->found->shown);
    else if (copy->write_error)
        say("%s: not exported: %s: %s%s", copy->found->shown, to, why,
            error == -EIO || error == -ENODEV || error == -ENXIO ? "; was the stick pulled out?" : "");
    else
        say("%s: not exported, it cannot be read: %s", copy->found->shown, strerror(-error));
}

/* 0; 1: copied, but the source is not as recorded; -errno after a line. */
static int copy_file(const struct folder *folder, const struct found *found, const char *path, int to) {
    char unfinished[NAME_MAX + sizeof UNFINISHED];
    struct copy copy = {.found = found, .fd = -1, .percent = -1};
    int error = verify_open(&copy.from, folder, found);
    bool opened = !error;

    snprintf(unfinished, sizeof unfinished, "%s%s", found->name, UNFINISHED);
    if (opened) {
        error = write_file(&copy, to, unfinished);
        if (error != -EINTR && found_is_given_up(&copy.from.use, found)) {
            copy.write_error = 0;
            error = -EBUSY;
        }
        if (!error)
            error = copy.write_error = give_name(&copy, to, unfinished);
        if (copy.fd >= 0 && close(copy.fd) && !error)
            error = copy.write_error = -errno;
        if (isatty(STDOUT_FILENO))
            printf("\r\033[K");
        fflush(stdout);
        if (error) {
            tell(&copy, path, error);
            unlinkat(to, unfinished, 0);
        }
    }
    bool good = error || verify_judge(&copy.from, found);
    verify_close(&copy.from);
    return error ? error : !good;
}

/* ---- Copy: all files ---- */

/* Whether all files fit onto the medium. False after a line. */
static bool has_room(const struct folder *folder, const bool *chosen, const char *path, int to) {
    struct statvfs medium;
    uint64_t bytes = 0;

    if (fstatvfs(to, &medium)) {
        say("%s: %s", path, strerror(errno));
        return false;
    }
    for (unsigned i = 0; i < folder->count; i++) {
        if (chosen[i]) /* even if it exists there: the old one is deleted only after the new one is written */
            bytes += (folder->file[i].bytes / medium.f_frsize + 2) * medium.f_frsize;
    }
    uint64_t room = (uint64_t)medium.f_bavail * medium.f_frsize;
    if (bytes > room)
        say("%s: %" PRIu64 " MB are needed, %" PRIu64 " MB are free; nothing was copied", path,
            (bytes + (1 << 20) - 1) >> 20, room >> 20);
    return bytes <= room;
}

int export_files(const struct folder *folder, const bool *chosen, const char *path) {
    unsigned count = 0, done = 0, copied = 0, doubtful = 0;
    int to = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC), error = 0;

    if (to < 0) {
        say("%s: %s", path, strerror(errno));
        return EXIT_FAILED;
    }
    for (unsigned i = 0; i < folder->count; i++)
        count += chosen[i];
    if (folder->pool >= 0 && !pool_can_hold(folder->pool))
        say("files may be given up for new recordings while they are copied; copy as root or as the recorder's user");
    if (!has_room(folder, chosen, path, to)) {
        close(to);
        return EXIT_FAILED;
    }
    for (unsigned i = 0; i < folder->count && (!error || error == -EBUSY || error == -EBADMSG); i++) {
        if (!chosen[i])
            continue;
        done++;
        error = copy_file(folder, &folder->file[i], path, to);
        copied += error >= 0;
        doubtful += error > 0;
        if (error >= 0) {
            printf("%s: %" PRIu64 " MB, %u of %u\n", folder->file[i].shown,
                   (folder->file[i].bytes + (1 << 20) - 1) >> 20, done, count);
            error = 0;
        }
        fflush(stdout);
    }
    close(to);
    return copied == count && !doubtful ? EXIT_OK : EXIT_FAILED;
}

/* ---- Read ---- */

/* `to`: the error of a write. */
static int put(void *to, const unsigned char *bytes, size_t size) {
    int *write_error = to;

    return *write_error = bytes_write(STDOUT_FILENO, bytes, size);
}

/* For a program that has to announce it before the bytes. */
static int put_size(const struct found *found) {
    char line[32];
    int length = snprintf(line, sizeof line, "%" PRIu64 "\n", found->bytes);

    return bytes_write(STDOUT_FILENO, (const unsigned char *)line, (size_t)length);
}

int read_file(const struct folder *folder, const struct found *found, uint64_t from, bool size) {
    struct found_use use;
    int write_error = 0;

    if (found->state >= FOUND_INTERRUPTED) {
        say("%s: is not finished", found->shown);
        return EXIT_FAILED;
    }
    if (from > found->bytes && !size) {
        say("%s: has %" PRIu64 " bytes only", found->shown, found->bytes);
        return EXIT_USAGE;
    }
    int error = found_open(folder, found, &use);
    if (!error && found_is_given_up(&use, found)) /* nothing of a new recording is written */
        error = -EBUSY;
    if (!error && size)
        error = write_error = put_size(found);
    if (!error)
        error = bytes_read_from(use.fd, use.direct, from, found->bytes, put, &write_error);
    /* Without a hold (another user's pool) the bytes may be those of a new recording. */
    if (!write_error && error != -EINTR && found_is_given_up(&use, found))
        error = -EBUSY;
    if (write_error)
        say("standard output: %s", strerror(-error));
    else if (error)
        say("%s: %s", found->shown,
            error == -EBUSY     ? "was given up for a new recording"
            : error == -EINTR   ? "not read to its end, told to stop"
            : error == -ENODATA ? "is shorter than its recording"
                                : strerror(-error));
    found_close(&use);
    return error ? EXIT_FAILED : EXIT_OK;
}

/* ---- Remove ---- */

/* A file outside the pool has no lock: a lease for reading is refused while another program writes it. */
static int lease(const struct folder *folder, const struct found *found) {
    int fd = openat(folder->fd, found->name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);

    if (fd < 0)
        return -errno;
    if (!fcntl(fd, F_SETLEASE, F_RDLCK) || errno != EAGAIN) /* other errors: this file system has no leases */
        return fd;
    close(fd);
    return -EBUSY;
}

/* A descriptor that keeps other programs from using the file until it is closed; -errno; -EBUSY: one uses it. */
static int hold(const struct folder *folder, const struct found *found) {
    if (found->state >= FOUND_INTERRUPTED)
        return -EBUSY;
    if (!found->id)
        return lease(folder, found);
    int fd = pool_hold_alone(folder->pool, found->id);
    return fd == -EAGAIN ? -EBUSY : fd;
}

static const char *reason(const struct found *found, int error) {
    if (error != -EBUSY)
        return strerror(-error);
    if (found->state == FOUND_INTERRUPTED)
        return "its recording was interrupted; a recorder finishes it when it starts";
    return found->state == FOUND_RECORDING || !found->id ? "is being recorded" : "is being copied or read";
}

/* 0 or -errno. The name remains that of this file: only this user gives names, and never one that was used. */
static int remove_file(const struct folder *folder, const struct found *found) {
    int held = hold(folder, found);
    int error = held < 0 ? held : unlinkat(folder->fd, found->name, 0) ? -errno : 0;

    if (held >= 0)
        close(held);
    return error;
}

/* Whether none of the files is in use. False after a line for each that is. */
static bool all_free(const struct folder *folder, const bool *chosen) {
    bool free = true;

    for (unsigned i = 0; i < folder->count; i++) {
        int held = chosen[i] ? hold(folder, &folder->file[i]) : -1;

        if (held >= 0)
            close(held);
        if (!chosen[i] || held >= 0)
            continue;
        say("%s: not removed: %s", folder->file[i].shown, reason(&folder->file[i], held));
        free = false;
    }
    return free;
}

int remove_files(const struct folder *folder, const bool *chosen) {
    int status = EXIT_OK;

    if (!all_free(folder, chosen)) {
        say("nothing was removed");
        return EXIT_FAILED;
    }
    for (unsigned i = 0; i < folder->count; i++) {
        const struct found *found = &folder->file[i];
        int error = chosen[i] ? remove_file(folder, found) : 0;

        if (error) {
            say("%s: not removed: %s", found->shown, reason(found, error));
            status = EXIT_FAILED;
        } else if (chosen[i]) {
            printf("%s: removed\n", found->shown);
        }
    }
    if (fsync(folder->fd)) {
        say("%s", strerror(errno));
        status = EXIT_FAILED;
    }
    return status;
}
