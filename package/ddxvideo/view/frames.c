/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frames.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "find.h"
#include "frames_index.h"
#include "pool_files.h"

#define SLICE INT64_C(5000000) /* ns */

static int add_part(struct frames *frames, const struct frames_part *part) {
    struct frames_part *more = realloc(frames->part, (frames->parts + 1) * sizeof *more);

    if (more)
        frames->part = more;
    if (!more || !part->path) {
        free(part->path);
        free(part->index);
        return -ENOMEM;
    }
    more[frames->parts++] = *part;
    return 0;
}

static char *join(const char *folder, const char *name) {
    char *path = NULL;

    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

/* The files of this file's recording, in order. */
static int add_recording(struct frames *frames, const char *path, const struct folder *folder,
                         const struct found *chosen) {
    unsigned number = chosen->number;
    int error = 0;

    for (unsigned i = 0; i < folder->count && !error; i++) {
        const struct found *found = &folder->file[i];
        char data[POOL_PATH], index[POOL_PATH], pool[PATH_MAX];

        if (!found->id || found->session != chosen->session || strcmp(found->item, chosen->item))
            continue;
        pool_data_name(data, found->id);
        pool_index_name(index, found->id);
        snprintf(pool, sizeof pool, "%s/" POOL_FOLDER, path);
        bool named = found->state < FOUND_INTERRUPTED;
        error = add_part(frames, &(struct frames_part){.path = named ? join(path, found->name) : join(pool, data),
                                                       .index = join(pool, index),
                                                       .follows = frames->parts && found->number == number + 1});
        number = found->number;
    }
    snprintf(frames->name, sizeof frames->name, "%.63s", chosen->item);
    return error;
}

/* True: the file belongs to a recording with an index. */
static bool find_recording(struct frames *frames, const char *path, int *error) {
    char folder_copy[PATH_MAX], name_copy[PATH_MAX], pool[PATH_MAX + 8];
    struct folder folder;

    snprintf(folder_copy, sizeof folder_copy, "%s", path);
    snprintf(name_copy, sizeof name_copy, "%s", path);
    const char *where = dirname(folder_copy), *name = basename(name_copy);
    snprintf(pool, sizeof pool, "%s/" POOL_FOLDER, where);
    if (access(pool, R_OK | X_OK)) /* not a recorder's folder: ignore other files in it */
        return false;
    const struct found *chosen = NULL;
    if (!folder_open(&folder, where))
        for (unsigned i = 0; i < folder.count; i++)
            if (folder.file[i].id && !strcmp(folder.file[i].name, name))
                chosen = &folder.file[i];
    if (chosen)
        *error = add_recording(frames, where, &folder, chosen);
    folder_close(&folder);
    return chosen;
}

int frames_open(struct frames *frames, const char *path) {
    char copy[PATH_MAX];
    int error = 0;

    *frames = (struct frames){.step = 1};
    if (find_recording(frames, path, &error))
        return error;
    snprintf(copy, sizeof copy, "%s", path);
    snprintf(frames->name, sizeof frames->name, "%.63s", basename(copy));
    char *end = strrchr(frames->name, '.');
    if (end && end != frames->name)
        *end = 0;
    return add_part(frames, &(struct frames_part){.path = strdup(path)});
}

void frames_close(struct frames *frames) {
    frames_scan_end(frames);
    for (unsigned i = 0; i < frames->parts; i++) {
        free(frames->part[i].path);
        free(frames->part[i].index);
    }
    free(frames->part);
    free(frames->entry);
}

/* Reads a part, or some of it. */
static int work_once(struct frames *frames) {
    struct frames_part *part = &frames->part[frames->next];
    int more = part->index && !frames->scan ? frames_index_read(frames, part) : -EBADMSG;

    if (more == -EBADMSG) /* no index, or a damaged one */
        more = frames_scan(frames, part);
    if (more < 0)
        return more;
    if (!more)
        frames->next++;
    frames->complete = frames->next == frames->parts;
    return 0;
}

int frames_work(struct frames *frames) {
    int64_t end = ddx_time_now() + SLICE;
    int error = 0;

    while (!error && !frames->complete && ddx_time_now() < end)
        error = work_once(frames);
    return error;
}
