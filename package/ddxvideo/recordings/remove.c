/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "remove.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "pool_files.h"
#include "program.h"

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
static int take(const struct folder *folder, const struct found *found) {
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
    int held = take(folder, found);
    int error = held < 0 ? held : unlinkat(folder->fd, found->name, 0) ? -errno : 0;

    if (held >= 0)
        close(held);
    return error;
}

/* Whether none of the files is in use. False after a line for each that is. */
static bool all_free(const struct folder *folder, const bool *chosen) {
    bool free = true;

    for (unsigned i = 0; i < folder->count; i++) {
        int held = chosen[i] ? take(folder, &folder->file[i]) : -1;

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
