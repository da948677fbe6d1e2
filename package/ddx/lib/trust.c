/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "trust.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

/* Cut off the last part of a path; false: there is no folder above it. */
static bool go_up(char *path) {
    char *slash = strrchr(path, '/');

    if (!slash || slash == path)
        return false;
    *slash = 0;
    return true;
}

/* Any user may create files there; with the sticky bit, users cannot replace files of other users. */
static bool is_common(const struct stat *status) {
    return status->st_mode & S_IWOTH;
}

int ddx_folder_owner(const char *path, uid_t *owner) {
    char folder[sizeof(((struct sockaddr_un *)0)->sun_path)];
    struct stat status, above;

    snprintf(folder, sizeof folder, "%s", path);
    if (!go_up(folder))
        return -EINVAL;
    if (lstat(folder, &status))
        return -errno;
    if (!S_ISDIR(status.st_mode) || (is_common(&status) && !(status.st_mode & S_ISVTX)))
        return -EPERM;
    *owner = status.st_uid;
    if (status.st_uid == 0 || status.st_uid == getuid() || !go_up(folder))
        return 0;
    /* The system may have made it for the store's user, as /run/ddx; but in a common folder that user made it. */
    return stat(folder, &above) || is_common(&above) ? -EPERM : 0;
}

bool ddx_peer_trusted(int socket, uid_t owner) {
    struct ucred peer;
    socklen_t length = sizeof peer;

    return !getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &peer, &length) &&
           (peer.uid == 0 || peer.uid == getuid() || peer.uid == owner);
}
