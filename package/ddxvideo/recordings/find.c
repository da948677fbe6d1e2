/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "find.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "ddx_time.h"
#include "mp4_read.h"
#include "pool_files.h"
#include "pool_names.h"
#include "schedule.h"
#include "y4m.h"

/* ---- Facts on one file ---- */

/* A frame lasts until the next one, the last one as long as the others. */
static int64_t lasts(int64_t first, int64_t last, uint64_t frames) {
    return frames < 2 || last < first ? 0 : (last - first) / (int64_t)(frames - 1) * (int64_t)frames;
}

/*
 * Open a file of this folder for reading, with more flags. Links are not followed, devices and pipes not waited for,
 * since root lists and copies recordings, and another user may own the folder. -errno; -EBADF: not a file.
 */
static int find_open(int folder, const char *name, int flags) {
    struct stat status;
    int fd = openat(folder, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | flags);

    if (fd < 0)
        return -errno;
    if (!fstat(fd, &status) && S_ISREG(status.st_mode))
        return fd;
    close(fd);
    return -EBADF;
}

/* ---- With an index ---- */

/* The header has no counts yet. */
static void count_so_far(int fd, struct found *found) {
    struct index_file *index = malloc(sizeof *index);

    if (!index || index_read(fd, index)) {
        free(index);
        return;
    }
    found->frames = index_count(index, UINT64_MAX);
    for (uint64_t i = 0; i < found->frames; i++) {
        found->lost_store += index->entry[i].lost_store;
        found->lost_ring += index->entry[i].lost_ring;
        found->lost_encode += index->entry[i].lost_encode;
        found->bytes = index->entry[i].offset + index->entry[i].bytes;
        found->duration = lasts(index->header.start, index->entry[i].time, found->frames);
    }
    free(index);
}

static void read_length(int fd, const struct index_header *header, struct found *found) {
    struct index_entry last;
    off_t at = (off_t)(INDEX_BLOCK + (header->frames - 1) * sizeof last);

    if (header->frames && pread(fd, &last, sizeof last, at) == (ssize_t)sizeof last &&
        index_good_entry(&last, header->recording, header->frames - 1))
        found->duration = lasts(header->start, last.time, header->frames);
}

/*
 * Fill in all but a changed name, from the index of found->id. False: not a recording, but free or deleted. `named`:
 * the file has a name.
 */
static bool find_indexed(int pool, bool named, struct found *found) {
    char name[POOL_PATH];
    struct index_header header;

    pool_index_name(name, found->id);
    int fd = find_open(pool, name, 0);
    bool good = fd >= 0 && pool_read_header(fd, &header) && header.state >= INDEX_RECORDING &&
                (named || header.state != INDEX_NAMED);
    if (good) {
        strcpy(found->name, header.name);
        strcpy(found->item, header.item);
        found->recording = header.recording;
        found->number = header.number;
        found->session = header.session ? header.session : header.number;
        found->wall = header.wall;
        found->frames = header.frames;
        found->bytes = header.bytes;
        found->lost_store = header.lost_store;
        found->lost_ring = header.lost_ring;
        found->lost_encode = header.lost_encode;
        found->state = header.flags & INDEX_RECOVERED ? FOUND_RECOVERED : FOUND_FINISHED;
    }
    if (good && !named)
        found->state = pool_is_locked(pool, found->id) ? FOUND_RECORDING : FOUND_INTERRUPTED;
    if (good && header.state == INDEX_RECORDING)
        count_so_far(fd, found);
    else if (good)
        read_length(fd, &header, found);
    if (fd >= 0)
        close(fd);
    return good;
}

/* ---- Without ---- */

/* <item>-<number>-<UTC>.y4m or .mp4; another name is an item without a number. */
static void read_name(struct found *found) {
    struct tm utc = {.tm_year = 0};
    const char *end = pool_name_number(found->name, &found->number);

    if (end && strptime(strrchr(end, '-') + 1, "%Y%m%dT%H%M%SZ", &utc))
        found->wall = (int64_t)timegm(&utc) * SECOND;
    if (!end)
        end = found->name + strlen(found->name) - strlen(".y4m");
    size_t length = (size_t)(end - found->name);
    if (length >= sizeof found->item)
        length = sizeof found->item - 1;
    memcpy(found->item, found->name, length);
    found->item[length] = 0;
    found->session = found->number;
}

/* The line at an offset, without its line feed; its length with it, 0 if there is none. */
static size_t read_line(int fd, uint64_t at, char line[Y4M_HEADER_MAX]) {
    ssize_t got = pread(fd, line, Y4M_HEADER_MAX - 1, (off_t)at);

    if (got <= 0)
        return 0;
    line[got] = 0;
    char *end = strchr(line, '\n');
    if (!end)
        return 0;
    *end = 0;
    return (size_t)(end - line) + 1;
}

/* Reads the FRAME lines, and skips the pictures. */
static void walk(int fd, const struct y4m_header *header, uint64_t at, struct found *found) {
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    uint64_t picture = 0;
    int64_t time, last = -1;
    size_t length;

    for (int plane = 0; plane < 4; plane++)
        picture += y4m_plane_bytes(header, plane);
    while (at < found->bytes && (length = read_line(fd, at, line)) && y4m_parse_frame(line, &time, error) &&
           found->bytes - at >= length + picture) {
        at += length + picture;
        found->frames++;
        last = time;
    }
    if (at < found->bytes)
        found->state = FOUND_CUT_OFF;
    if (last >= 0)
        found->duration = lasts(0, last, found->frames);
    else if (header->geometry.rate_num)
        found->duration =
            schedule_offset(found->frames, (uint32_t)header->geometry.rate_num, (uint32_t)header->geometry.rate_den);
}

/* Of an MP4 file. False: not one of ours. */
static bool look_at_mp4(int fd, struct found *found) {
    struct mp4_file file;
    struct mp4_fragment last = {.number = 0};

    if (mp4_open(&file, fd))
        return false;
    if (!mp4_last_frame(&file, &last)) {
        enum mp4_next next;

        while ((next = mp4_next_frame(&file, &last)) == MP4_FRAME)
            continue;
        if (next != MP4_END)
            found->state = FOUND_CUT_OFF;
        last = (struct mp4_fragment){.number = file.frames, .time = file.time};
    }
    found->frames = last.number;
    found->duration = (int64_t)(last.time + file.format.duration) * 1000;
    return true;
}

/* Fill in all from the file found->name itself. False: neither Y4M nor MP4, and not named like a recording either. */
static bool find_plain(int folder, struct found *found) {
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    struct y4m_header header;
    struct stat status;
    int fd = find_open(folder, found->name, 0);

    if (fd < 0 || fstat(fd, &status)) {
        if (fd >= 0)
            close(fd);
        return false;
    }
    bool mp4 = mp4_is_any(fd);
    size_t length = mp4 ? 0 : read_line(fd, 0, line);
    bool good = mp4 ? look_at_mp4(fd, found) : length && y4m_parse_header(line, Y4M_SAME, &header, error);
    read_name(found);
    found->bytes = (uint64_t)status.st_size;
    posix_fadvise(fd, 0, 0, POSIX_FADV_RANDOM); /* do not read ahead into the pictures */
    if (good && !mp4)
        walk(fd, &header, length, found);
    else if (!good)
        found->state = FOUND_CUT_OFF;
    close(fd);
    return good || (found->number && found->bytes); /* only a recorder makes such names */
}

/* ---- A folder ---- */

#define LOOKS_MAX 10

/* ---- Files of the pool ---- */

struct pooled {
    ino_t inode;
    struct found found;
};

struct pooled_list {
    struct pooled *file;
    unsigned count;
};

static bool add_pooled(struct pooled_list *list, const struct pooled *file) {
    struct pooled *more = realloc(list->file, (list->count + 1) * sizeof *more);

    if (!more)
        return false;
    list->file = more;
    more[list->count++] = *file;
    return true;
}

static int look_once(const struct folder *folder, struct pooled_list *list) {
    DIR *pool = folder->pool < 0 ? NULL : pool_list(folder->pool);
    int error = 0;

    if (!pool)
        return folder->pool < 0 ? 0 : -errno;
    for (struct dirent *entry = readdir(pool); entry && !error; entry = readdir(pool)) {
        struct stat status;
        long id = pool_data_id(entry->d_name);

        if (!id || fstatat(folder->pool, entry->d_name, &status, 0))
            continue;
        struct pooled file = {.inode = status.st_ino, .found = {.id = id}};
        bool named = status.st_nlink > 1, indexed = find_indexed(folder->pool, named, &file.found);
        if (!indexed)
            file.found = (struct found){.spoilt = true};
        if ((indexed || named) && !add_pooled(list, &file))
            error = -ENOMEM;
    }
    closedir(pool);
    return error;
}

static bool same(const struct pooled_list *one, const struct pooled_list *other) {
    bool same = one->count == other->count;

    for (unsigned i = 0; same && i < one->count; i++) {
        const struct found *a = &one->file[i].found, *b = &other->file[i].found;

        same = a->id == b->id && a->number == b->number && a->state == b->state;
    }
    return same;
}

/*
 * A recorder may end a file and begin the next one during the scan, which then sees the next one before it is locked,
 * and the former one unlocked: a running recording would be reported as interrupted. So scans repeat until two agree.
 */
static int look_at_pool(const struct folder *folder, struct pooled_list *list) {
    int error = look_once(folder, list);

    for (unsigned looks = 1; !error && looks < LOOKS_MAX; looks++) {
        struct pooled_list before = *list;

        *list = (struct pooled_list){NULL, 0};
        error = look_once(folder, list);
        bool agreed = same(&before, list);
        free(before.file);
        if (agreed)
            break;
    }
    return error;
}

/* ---- Files of the folder ---- */

void found_clean(char *text) {
    for (; *text; text++)
        if (*text < ' ' || *text > '~')
            *text = '?';
}

static int add(struct folder *folder, const struct found *found) {
    struct found *more = realloc(folder->file, (folder->count + 1) * sizeof *more);

    if (!more)
        return -ENOMEM;
    folder->file = more;
    more[folder->count] = *found;
    strcpy(more[folder->count].shown, found->name);
    found_clean(more[folder->count++].shown);
    return 0;
}

static struct pooled *with_inode(const struct pooled_list *list, ino_t inode) {
    for (unsigned i = 0; i < list->count; i++)
        if (list->file[i].inode == inode)
            return &list->file[i];
    return NULL;
}

static int add_named(struct folder *folder, const char *name, const struct pooled_list *list) {
    struct stat status;
    struct found found = {.id = 0};

    if (fstatat(folder->fd, name, &status, AT_SYMLINK_NOFOLLOW) || !S_ISREG(status.st_mode))
        return 0;
    struct pooled *pooled = with_inode(list, status.st_ino);
    if (pooled) {
        found = pooled->found;
        pooled->found.id = 0; /* taken */
    }
    snprintf(found.name, sizeof found.name, "%s", name);
    if (found.id)
        found.bytes = (uint64_t)status.st_size;
    else if (!find_plain(folder->fd, &found) && !found.spoilt)
        return 0;
    return add(folder, &found);
}

static int look_at_names(struct folder *folder, const struct pooled_list *list) {
    DIR *names = pool_list(folder->fd);
    int error = 0;

    if (!names)
        return -errno;
    for (struct dirent *entry = readdir(names); entry && !error; entry = readdir(names)) {
        const char *end = strrchr(entry->d_name, '.');

        if (end && end != entry->d_name && (!strcmp(end, ".y4m") || !strcmp(end, ".mp4")))
            error = add_named(folder, entry->d_name, list);
    }
    closedir(names);
    for (unsigned i = 0; i < list->count && !error; i++)
        if (list->file[i].found.id && list->file[i].found.state >= FOUND_INTERRUPTED)
            error = add(folder, &list->file[i].found); /* has no name yet */
    return error;
}

static int in_order(const void *a, const void *b) {
    const struct found *one = a, *other = b;

    if (one->session != other->session)
        return one->session < other->session ? -1 : 1;
    if (one->number != other->number)
        return one->number < other->number ? -1 : 1;
    return strcmp(one->name, other->name);
}

int folder_open(struct folder *folder, const char *path) {
    struct pooled_list list = {NULL, 0};

    *folder = (struct folder){.fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC), .pool = -1};
    if (folder->fd < 0)
        return -errno;
    folder->pool = openat(folder->fd, POOL_FOLDER, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    int error = folder->pool < 0 && errno != ENOENT ? -errno : look_at_pool(folder, &list);
    if (!error)
        error = look_at_names(folder, &list);
    free(list.file);
    if (folder->count)
        qsort(folder->file, folder->count, sizeof *folder->file, in_order);
    return error;
}

void folder_close(struct folder *folder) {
    free(folder->file);
    if (folder->pool >= 0)
        close(folder->pool);
    if (folder->fd >= 0)
        close(folder->fd);
}

/* ---- One file ---- */

const char *found_state_name(enum found_state state) {
    static const char *const names[] = {"finished", "recovered", "cut off", "interrupted", "recording"};

    return names[state];
}

/* The descriptor of its bytes, or -errno. */
static int open_data(const struct folder *folder, const struct found *found, bool *direct) {
    char name[POOL_PATH];

    pool_data_name(name, found->id);
    int from = found->id ? folder->pool : folder->fd;
    const char *path = found->id ? name : found->name;
    int fd = find_open(from, path, O_DIRECT);
    *direct = fd >= 0;
    return fd == -EINVAL ? find_open(from, path, 0) : fd;
}

/* Hold a file of the pool, and open its index. */
static int open_pooled(const struct folder *folder, const struct found *found, struct found_use *use) {
    char name[POOL_PATH];
    /* A file of a running recording is locked by its recorder. */
    int hold = found->state < FOUND_INTERRUPTED ? pool_hold_file(folder->pool, found->id) : -1;

    if (hold == -EAGAIN)
        return -EBUSY;
    use->hold = hold < 0 ? -1 : hold;
    pool_index_name(name, found->id);
    int fd = find_open(folder->pool, name, 0);
    if (fd < 0)
        return fd;
    use->index_fd = fd;
    return 0;
}

int found_open(const struct folder *folder, const struct found *found, struct found_use *use) {
    *use = (struct found_use){.fd = -1, .index_fd = -1, .hold = -1};
    int error = found->id ? open_pooled(folder, found, use) : 0;
    int fd = error ? error : open_data(folder, found, &use->direct);
    if (fd < 0)
        return fd;
    use->fd = fd;
    return 0;
}

void found_close(const struct found_use *use) {
    const int fds[] = {use->fd, use->index_fd, use->hold};

    for (size_t i = 0; i < sizeof fds / sizeof fds[0]; i++)
        if (fds[i] >= 0)
            close(fds[i]);
}

bool found_is_given_up(const struct found_use *use, const struct found *found) {
    struct index_header header;

    return use->index_fd >= 0 && (!pool_read_header(use->index_fd, &header) || header.recording != found->recording);
}
