/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "free_space.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "pool_files.h"

/* Adds a file of the pool if it has no recording. */
static void add_file(int pool, long id, struct free_space *room) {
    char name[POOL_PATH];
    struct stat status;
    struct index_header header;

    pool_data_name(name, id);
    if (fstatat(pool, name, &status, AT_SYMLINK_NOFOLLOW) || !S_ISREG(status.st_mode) || status.st_nlink > 1)
        return;
    pool_index_name(name, id);
    /* Also called by root, in a folder of the recorder's user: no link is followed, no pipe is waited for. */
    int fd = openat(pool, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    bool good = fd >= 0 && pool_read_header(fd, &header);
    if (fd >= 0)
        close(fd);
    if (good && (header.state == INDEX_RECORDING || header.state == INDEX_FINISHED))
        return;
    room->ready += good && header.state == INDEX_FREE;
    room->prepared += (uint64_t)status.st_size;
    room->usable += (uint64_t)status.st_size;
}

int free_space_look(const char *place, struct free_space *room) {
    struct statvfs disk;

    if (statvfs(place, &disk))
        return -errno;
    room->free = (uint64_t)disk.f_bavail * disk.f_frsize;
    room->usable = room->free > POOL_LEFT_FREE ? room->free - POOL_LEFT_FREE : 0;
    room->prepared = 0;
    room->ready = 0;
    int folder = open(place, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int pool = folder < 0 ? -1 : openat(folder, POOL_FOLDER, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    DIR *list = pool < 0 ? NULL : pool_list(pool);
    for (struct dirent *entry = list ? readdir(list) : NULL; entry; entry = readdir(list)) {
        long id = pool_data_id(entry->d_name);

        if (id)
            add_file(pool, id, room);
    }
    if (list)
        closedir(list);
    if (pool >= 0)
        close(pool);
    if (folder >= 0)
        close(folder);
    return 0;
}
