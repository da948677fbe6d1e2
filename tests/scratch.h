/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A temporary folder of the test, in TMPDIR or /tmp. It is removed when the program exits, also when a check fails;
 * child processes do not remove it.
 */
#ifndef SCRATCH_H
#define SCRATCH_H

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static char scratch_folder[80]; /* a store's socket in it has an address of 108 bytes at most */
static pid_t scratch_owner;

static inline int scratch_remove_one(const char *path, const struct stat *info, int kind, struct FTW *place) {
    (void)info, (void)kind;
    return place->level ? remove(path) : 0;
}

static inline void scratch_clear(void) {
    nftw(scratch_folder, scratch_remove_one, 8, FTW_DEPTH | FTW_PHYS);
}

static inline void scratch_remove(void) {
    if (getpid() != scratch_owner)
        return;
    scratch_clear();
    rmdir(scratch_folder);
}

static inline void scratch_make(void) {
    const char *parent = getenv("TMPDIR");
    int length = snprintf(scratch_folder, sizeof scratch_folder, "%s/ddx-test-XXXXXX", parent ? parent : P_tmpdir);

    if (length >= (int)sizeof scratch_folder) {
        fprintf(stderr, "TMPDIR %s is too long for a socket in it\n", parent);
        exit(1);
    }
    if (!mkdtemp(scratch_folder) || atexit(scratch_remove)) {
        perror(scratch_folder);
        exit(1);
    }
    scratch_owner = getpid();
}

/* The path of a file in the folder; to be freed. */
static inline char *scratch_path(const char *name) {
    char *path;

    if (asprintf(&path, "%s/%s", scratch_folder, name) < 0)
        abort();
    return path;
}

#endif
