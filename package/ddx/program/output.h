/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where recordings go: one named file, or a folder that gets a new file for each. */
#ifndef DDX_OUTPUT_H
#define DDX_OUTPUT_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

struct output {
    const char *place;     /* as given */
    const char *name;      /* of the item, for names of files in a folder */
    const char *extension; /* of such names: "y4m" */
    bool is_folder;
};

/* Look at the place; 0 or -errno if nothing could be recorded there. */
int output_check(struct output *output, const char *place, const char *name, const char *extension);

/*
 * Open the next file; its path into path[PATH_MAX]. In a folder it is called <name>-<NNNNNN>-<UTC>.<extension>, with a
 * number above all that are there: recordings keep their order, and are not overwritten, however wrong the clock
 * is. Returns the file descriptor or -errno.
 */
int output_open(const struct output *output, char *path);

/*
 * Delete files that output_open() made in a folder, oldest numbers first, until all that are left have `most` bytes or
 * less; a line for each says so. 0 or -errno: a file cannot be deleted, and those behind it were not.
 */
int output_keep(const struct output *output, uint64_t most);

#endif
