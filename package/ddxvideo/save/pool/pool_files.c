/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "pool_files.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "crc32c.h"

/* ---- Locks ---- */

/*
 * Locks of the pool: bytes of the file `lock`, which only its owner and root can open. A user can lock each file that
 * the user can read: with locks on the files themselves, each user of the machine could stop all recording.
 *
 * The file also has the number of the newest recording, which its index gets only with the first flush.
 */

#define LOCK "lock"

/* Byte 0 is for the pool, byte N for file N. A lock belongs to an open file, so each claim opens the lock again. */
static int set(int fd, int how, short type, long byte) {
    struct flock lock = {.l_type = type, .l_whence = SEEK_SET, .l_start = byte, .l_len = 1};
    int failed;

    do
        failed = fcntl(fd, how, &lock);
    while (failed && errno == EINTR);
    return failed ? -errno : 0;
}

/* Does not wait, even if the name belongs to a pipe. */
static int open_lock(int folder, int flags) {
    return openat(folder, LOCK, flags | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
}

int pool_lock_create(int folder) {
    struct stat status;
    int fd = open_lock(folder, O_RDWR | O_CREAT | O_EXCL);

    if (fd < 0 && errno == EEXIST)
        fd = open_lock(folder, O_RDWR);
    else if (fd >= 0 && !geteuid() && !fstat(folder, &status) && fchown(fd, status.st_uid, status.st_gid)) {
        int error = errno; /* otherwise the owner of the pool could not open what root created */

        close(fd);
        return -error;
    }
    if (fd < 0)
        return -errno;
    bool good = !fstat(fd, &status) && S_ISREG(status.st_mode);
    if (good && status.st_mode & 077 && status.st_uid == geteuid())
        good = !fchmod(fd, 0600);
    if (!good)
        close(fd);
    return good ? fd : -EBADF;
}

void pool_lock(struct pool *pool) {
    pthread_mutex_lock(&pool->lock);
    set(pool->lock_fd, F_OFD_SETLKW, F_WRLCK, 0);
}

void pool_unlock(struct pool *pool) {
    set(pool->lock_fd, F_OFD_SETLK, F_UNLCK, 0);
    pthread_mutex_unlock(&pool->lock);
}

void pool_wait_for_recovery(struct pool *pool) {
    pthread_mutex_lock(&pool->lock);
    while (pool->recovering)
        pthread_cond_wait(&pool->changed, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}

/* ---- The newest number ---- */

#define MAGIC "DDXLOCK1"

struct newest {
    char magic[8];
    uint32_t number;
    uint32_t crc; /* of the fields before: after a power cut they may have any value */
};

void pool_set_newest(const struct pool *pool, uint32_t number) {
    struct newest newest = {.number = number};

    memcpy(newest.magic, MAGIC, sizeof newest.magic);
    newest.crc = crc32c(0, &newest, offsetof(struct newest, crc));
    /* A full disk may refuse it: then a recorder whose name is taken takes another number. */
    ssize_t done = pwrite(pool->lock_fd, &newest, sizeof newest, 0);
    (void)done;
}

uint32_t pool_newest(const struct pool *pool) {
    struct newest newest;

    if (pread(pool->lock_fd, &newest, sizeof newest, 0) != (ssize_t)sizeof newest ||
        memcmp(newest.magic, MAGIC, sizeof newest.magic) ||
        newest.crc != crc32c(0, &newest, offsetof(struct newest, crc)))
        return 0;
    return newest.number;
}

/* ---- Files ---- */

/* Locks a file as long as the result is open. */
static int lock_file(int folder, long id, int flags, short type) {
    int fd = open_lock(folder, flags);
    int error = fd < 0 ? -errno : set(fd, F_OFD_SETLK, type, id);

    if (error && fd >= 0)
        close(fd);
    return error ? error : fd;
}

int pool_hold_file(int folder, long id) {
    return lock_file(folder, id, O_RDONLY, F_RDLCK);
}

int pool_hold_alone(int folder, long id) {
    return lock_file(folder, id, O_RDWR, F_WRLCK);
}

bool pool_can_hold(int folder) {
    return !faccessat(folder, LOCK, R_OK, AT_EACCESS) || errno == ENOENT;
}

/* Reads /proc/locks, for programs that cannot open the lock. */
bool pool_is_locked(int folder, long id) {
    struct stat status;
    char line[256];
    bool found = false;
    FILE *locks = fstatat(folder, LOCK, &status, AT_SYMLINK_NOFOLLOW) ? NULL : fopen("/proc/locks", "re");

    while (locks && !found && fgets(line, sizeof line, locks)) {
        uintmax_t inode, byte;

        found = sscanf(line, "%*s OFDLCK %*s WRITE %*s %*[^:]:%*[^:]:%ju %ju", &inode, &byte) == 2 &&
                inode == (uintmax_t)status.st_ino && byte == (uintmax_t)id;
    }
    if (locks)
        fclose(locks);
    return found;
}

/* ---- Names and headers ---- */

void pool_data_name(char name[POOL_PATH], long id) {
    snprintf(name, POOL_PATH, "%06ld.y4m", id);
}

void pool_index_name(char name[POOL_PATH], long id) {
    snprintf(name, POOL_PATH, "%06ld.index", id);
}

static long pool_id(const char *name) {
    char own[POOL_PATH];
    const char *point = strchr(name, '.');
    long id = strtol(name, NULL, 10); /* at worst LONG_MAX, or LONG_MIN */

    if (!point || id < 1 || id > POOL_ID_MAX)
        return 0;
    pool_data_name(own, id);
    return strncmp(name, own, (size_t)(point - name) + 1) ? 0 : id;
}

long pool_data_id(const char *name) {
    const char *point = strchr(name, '.');

    return point && !strcmp(point, ".y4m") ? pool_id(name) : 0;
}

DIR *pool_list(int folder) {
    int fd = openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = fd < 0 ? NULL : fdopendir(fd);

    if (!list && fd >= 0)
        close(fd);
    return list;
}

int pool_each(struct pool *pool, bool (*visit)(struct pool *pool, long id, void *argument), void *argument) {
    DIR *folder = pool_list(pool->folder);

    if (!folder)
        return -errno;
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        long id = pool_data_id(entry->d_name);

        if (id && !visit(pool, id, argument))
            break;
    }
    closedir(folder);
    return 0;
}

bool pool_is_named(const struct pool *pool, long id) {
    char name[POOL_PATH];
    struct stat status;

    pool_data_name(name, id);
    return !fstatat(pool->folder, name, &status, 0) && status.st_nlink > 1;
}

void pool_forget(struct pool_file *file, struct index_header *header, uint64_t bytes) {
    *header = (struct index_header){.state = INDEX_RAW};
    file->written = bytes / INDEX_BLOCK * INDEX_BLOCK;
}

/* Opens a file past the page cache, if the file system supports that. */
static int open_file(const struct pool *pool, const char *name, int flags, bool *direct) {
    flags |= O_RDWR | O_CLOEXEC | O_NOFOLLOW;
    int fd = openat(pool->folder, name, flags | O_DIRECT, 0664);

    *direct = fd >= 0;
    if (fd < 0 && errno == EINVAL)
        fd = openat(pool->folder, name, flags & ~O_EXCL, 0664);
    return fd < 0 ? -errno : fd;
}

static int open_both(const struct pool *pool, long id, int flags, struct pool_file *file) {
    char name[POOL_PATH];
    bool direct;

    *file = (struct pool_file){.id = id, .fd = -1, .index_fd = -1};
    file->lock_fd = pool_hold_alone(pool->folder, id);
    if (file->lock_fd < 0)
        return file->lock_fd;
    pool_index_name(name, id);
    int error = file->index_fd = open_file(pool, name, flags, &direct);
    pool_data_name(name, id);
    if (error >= 0)
        file->fd = error = open_file(pool, name, flags, &file->direct);
    if (error < 0)
        pool_release(file);
    return error < 0 ? error : 0;
}

void pool_release(struct pool_file *file) {
    if (file->fd >= 0)
        close(file->fd);
    if (file->index_fd >= 0)
        close(file->index_fd);
    close(file->lock_fd); /* last, so that the next owner finds both files closed */
    file->fd = file->index_fd = file->lock_fd = -1;
}

bool pool_read_header(int fd, struct index_header *header) {
    _Alignas(INDEX_BLOCK) unsigned char block[INDEX_BLOCK];
    if (pread(fd, block, sizeof block, 0) != (ssize_t)sizeof block)
        return false;
    memcpy(header, block, sizeof *header);
    return index_good_header(header);
}

bool pool_claim(struct pool *pool, long id, struct pool_file *file, struct index_header *header) {
    if (open_both(pool, id, O_CREAT, file))
        return false;
    bool good = pool_read_header(file->index_fd, header);
    struct stat data, index;
    if (fstat(file->fd, &data) || fstat(file->index_fd, &index)) {
        pool_release(file);
        return false;
    }
    if (!good || index.st_size != INDEX_BYTES)
        *header = (struct index_header){.state = INDEX_RAW};
    else if (header->state == INDEX_FREE && (uint64_t)data.st_size != pool->bytes)
        header->state = INDEX_RAW; /* has another size */
    else if (header->state == INDEX_NAMED)
        pool_forget(file, header, (uint64_t)data.st_size);
    file->prepared = header->state != INDEX_RAW;
    return true;
}

struct search {
    struct pool_file *file;
    uint32_t state;
    bool found;
};

static bool claim_state(struct pool *pool, long id, void *argument) {
    struct search *search = argument;
    struct index_header header;

    if (pool_is_named(pool, id) || !pool_claim(pool, id, search->file, &header))
        return true;
    search->found = header.state == search->state;
    if (!search->found)
        pool_release(search->file);
    return !search->found;
}

bool pool_find(struct pool *pool, uint32_t state, struct pool_file *file) {
    struct search search = {.file = file, .state = state};

    pool_each(pool, claim_state, &search);
    return search.found;
}

int pool_create(struct pool *pool, struct pool_file *file) {
    long most = 0;
    DIR *folder = pool_list(pool->folder);

    if (!folder)
        return -errno;
    for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
        long id = pool_id(entry->d_name); /* of a file, or of an index alone */

        if (id > most)
            most = id;
    }
    closedir(folder);
    /* After the highest number the lowest free one: there are more numbers than files. */
    long id = most < POOL_ID_MAX ? most : 0;
    int error;
    do
        error = open_both(pool, ++id, O_CREAT | O_EXCL, file);
    while ((error == -EEXIST || error == -EAGAIN) && id < POOL_ID_MAX);
    return error;
}

int pool_write_header(const struct pool_file *file, struct index_header *header) {
    _Alignas(INDEX_BLOCK) unsigned char block[INDEX_BLOCK] = {0};
    index_seal_header(header);
    memcpy(block, header, sizeof *header);
    return pwrite(file->index_fd, block, sizeof block, 0) == (ssize_t)sizeof block ? 0 : -EIO;
}

int pool_write_index(const struct pool_file *file, uint32_t state) {
    struct index_file *index;

    if (posix_memalign((void **)&index, INDEX_BLOCK, sizeof *index))
        return -ENOMEM;
    memset(index, 0, sizeof *index);
    index->header.state = state;
    index_seal_header(&index->header);
    ssize_t done = pwrite(file->index_fd, index, sizeof *index, 0);
    int error = done < 0 ? -errno : done == (ssize_t)sizeof *index ? 0 : -ENOSPC;
    free(index);
    return error;
}

void pool_give_back(struct pool_file *file) {
    struct index_header header = {.state = file->prepared ? INDEX_FREE : INDEX_RAW};

    pool_write_header(file, &header);
    pool_release(file);
}

int pool_allocate(const struct pool *pool, struct pool_file *file) {
    /* Not posix_fallocate(): on ext3 it writes single bytes instead, which O_DIRECT refuses. */
    file->allocated = !fallocate(file->fd, 0, 0, (off_t)pool->bytes);
    return file->allocated || errno == EOPNOTSUPP ? 0 : -errno;
}

bool pool_has_room(const struct pool *pool) {
    struct statvfs disk;

    return !fstatvfs(pool->folder, &disk) &&
           (uint64_t)disk.f_bavail * disk.f_frsize >= pool->bytes + INDEX_BYTES + POOL_LEFT_FREE;
}

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
