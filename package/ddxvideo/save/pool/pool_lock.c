/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Locks of the pool: bytes of the file `lock`, which only its owner and root can open. A user can lock each file that
 * the user can read: with locks on the files themselves, each user of the machine could stop all recording.
 *
 * The file also has the number of the newest recording, which its index gets only with the first flush.
 */
#include "pool_lock.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "crc32c.h"

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

int pool_lock_file(const struct pool *pool, long id) {
    return lock_file(pool->folder, id, O_RDWR, F_WRLCK);
}

int pool_hold_file(int folder, long id) {
    return lock_file(folder, id, O_RDONLY, F_RDLCK);
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
