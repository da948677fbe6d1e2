/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "files.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "../lib/fault.h"
#include "holder.h"
#include "checkpoint.h"

#define OTHERS 64 /* most descriptors that were open when the store began */

static struct files *files;

static int others[OTHERS];
static unsigned other_count;

/* To be closed after the next commit. Not checkpointed: files_sweep() closes the descriptors of a dead worker. */
static int *closing;
static unsigned closing_count, closing_room;

void files_use_table(struct files *table) {
    files = table;
}

static struct file *file_at(int fd) {
    return files && fd >= 0 && (unsigned)fd < files->count ? &files->file[fd] : NULL;
}

int file_use(int fd) {
    if ((unsigned)fd >= files->count) {
        unsigned count = ((unsigned)fd + 1) * 2;
        struct checkpoint_payer client = checkpoint_charge(NULL, 0); /* the table is for all clients */
        struct file *more = checkpoint_allocate(count * sizeof *more);

        checkpoint_charge(client.account, client.most);
        if (!more)
            return -ENOMEM;
        if (files->count)
            memcpy(more, files->file, files->count * sizeof *more);
        checkpoint_free(files->file);
        files->file = more;
        files->count = count;
    }
    files->file[fd].users++;
    return 0;
}

static void close_later(int fd) {
    if (closing_count == closing_room) {
        int *more = realloc(closing, (closing_room * 2 + 64) * sizeof *more);

        if (!more)
            return; /* it stays open until the next worker sweeps */
        closing = more;
        closing_room = closing_room * 2 + 64;
    }
    closing[closing_count++] = fd;
}

void file_unuse(int fd) {
    struct file *file = file_at(fd);

    if (--file->users == 0 && file->closed) {
        file->closed = false;
        close_later(fd);
    }
}

void file_close(int fd) {
    struct file *file = file_at(fd);

    if (file && file->users)
        file->closed = true;
    else
        close_later(fd);
}

void files_commit(void) {
    checkpoint_commit();
    DDX_PASS(STORE_COMMITTED);
    while (closing_count) {
        close(closing[--closing_count]); /* the kernel frees the memory here, which may take long */
        holder_beat();
    }
}

/* Call `what` for each open descriptor except the folder's own. */
static void each_open(void (*what)(void *context, int fd), void *context) {
    DIR *folder = opendir("/proc/self/fd");

    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        int fd = atoi(entry->d_name);

        if (*entry->d_name != '.' && fd != dirfd(folder))
            what(context, fd);
    }
    if (folder)
        closedir(folder);
}

static void log_other(void *unused, int fd) {
    (void)unused;
    if (other_count < OTHERS)
        others[other_count++] = fd;
}

void files_begin(void) {
    each_open(log_other, NULL);
}

struct sweep {
    bool (*known)(int fd);
    void (*found)(void *context, int socket);
    void *context;
};

static bool is_connection(int fd) {
    int listens = 1, type = 0;
    socklen_t length = sizeof type;

    return !getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) && type == SOCK_SEQPACKET &&
           !getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &length) && !listens;
}

static void sweep(void *context, int fd) {
    const struct sweep *by = context;
    const struct file *file = file_at(fd);

    for (unsigned i = 0; i < other_count; i++)
        if (others[i] == fd)
            return;
    if ((file && file->users) || by->known(fd))
        return;
    if (is_connection(fd))
        by->found(by->context, fd);
    else
        close(fd);
}

void files_sweep(bool (*known)(int fd), void (*found)(void *context, int socket), void *context) {
    struct sweep by = {known, found, context};

    each_open(sweep, &by);
}
