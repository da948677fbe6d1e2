/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "listen.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "../lib/trust.h"
#include "../lib/wire.h"

#define LOCK_TRIES 100
#define BACKLOG 1024 /* waiting connections; a further one is refused as if no store ran */
#define LOCK_STEP 10000000 /* ns */

/* One store per port: the lock is held as long as this process lives, however it ends. */
static int lock_port(const char *path) {
    char name[sizeof(((struct sockaddr_un *)0)->sun_path) + 8];

    snprintf(name, sizeof name, "%s.lock", path);
    int fd = open(name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0)
        return -errno;
    /* After a store was killed, its worker may live a moment longer. */
    for (int i = 0; flock(fd, LOCK_EX | LOCK_NB); i++) {
        if (i == LOCK_TRIES) {
            close(fd);
            return -EADDRINUSE;
        }
        nanosleep(&(struct timespec){0, LOCK_STEP}, NULL);
    }
    return 0;
}

static int make_folder(const char *path) {
    char folder[sizeof(((struct sockaddr_un *)0)->sun_path)];
    uid_t owner;

    snprintf(folder, sizeof folder, "%s", path);
    *strrchr(folder, '/') = 0;
    if (mkdir(folder, 0755) && errno != EEXIST)
        return -errno;
    /* Programs trust no store in a folder that another user made or can change. */
    int result = ddx_folder_owner(path, &owner);
    if (result)
        return result;
    if (!strncmp(folder, "/tmp/", 5) && owner != getuid())
        return -EPERM;
    return access(folder, W_OK) ? -errno : 0;
}

int listen_on(int port, char *path, size_t bytes, bool *restarted) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int result = -ENOENT;

    for (unsigned i = 0; ddx_socket_path(i, port, path, bytes); i++)
        if (!(result = make_folder(path)))
            break;
    if (!result)
        result = lock_port(path);
    if (result)
        return result;
    *restarted = !access(path, F_OK);
    unlink(path);
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return -errno;
    /* Group and owner only; on the appliance the socket inherits the folder's group, ddx. */
    mode_t before = umask(0117);
    result = bind(fd, (struct sockaddr *)&address, sizeof address) || listen(fd, BACKLOG) ? -errno : 0;
    umask(before);
    if (result) {
        close(fd);
        return result;
    }
    return fd;
}
