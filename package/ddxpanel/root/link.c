/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "link.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

int link_make(struct link *link, int64_t now) {
    explicit_bzero(link, sizeof *link);
    int error = secret_make(link->text);
    if (!error)
        link->end = now + LINK_SECONDS;
    return error;
}

bool link_use(struct link *link, int64_t now, const char *text) {
    bool good = *link->text && now < link->end && secret_is(link->text, text);

    if (good)
        explicit_bzero(link, sizeof *link);
    return good;
}

int link_leave(const struct link *link, const char *path) {
    char new[PATH_MAX + 8];
    int error = 0;

    snprintf(new, sizeof new, "%s.new", path);
    unlink(new);
    int fd = open(new, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0)
        return -errno;
    if (write(fd, link, sizeof *link) != (ssize_t)sizeof *link)
        error = -EIO;
    close(fd);
    if (!error && rename(new, path))
        error = -errno;
    return error;
}

bool link_take(const char *path, int64_t now, const char *text) {
    struct link link;
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    bool good = fd >= 0 && read(fd, &link, sizeof link) == (ssize_t)sizeof link && !link.text[SECRET_TEXT];

    if (fd >= 0)
        close(fd);
    /* A file that cannot be removed would make the link work twice. */
    good = good && link_use(&link, now, text) && !unlink(path);
    explicit_bzero(&link, sizeof link);
    return good;
}
