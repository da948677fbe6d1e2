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
    bool keep; /* a named file that is there has what a former start recorded: the next free name is taken then */
};

/* Look at the place; 0 or -errno if nothing could be recorded there. */
int output_check(struct output *output, const char *place, const char *name, const char *extension);

/*
 * Open the next file; its path into path[PATH_MAX]. In a folder it is called <name>-<NNNNNN>-<UTC>.<extension>, with a
 * number above all that are there: recordings keep their order, and are not overwritten, however wrong the clock
 * is. A place of that name is used: emptied, or with `keep` the next free one of FILE, FILE-2, FILE-3 ... (before the
 * extension); `-` is standard output. A pipe is waited for until it has a reader. A file is locked as long as it is
 * open. Returns the file descriptor or -errno: -EWOULDBLOCK, another program records into it; -ECANCELED, a request to
 * stop came before the pipe had a reader.
 */
int output_open(const struct output *output, char *path);

/* The folder that its files are in, into folder[PATH_MAX]. */
void output_folder(const struct output *output, char *folder);

/* The number in the name of a file that output_open() makes in a folder; 0 if it is none of these. */
long output_number(const struct output *output, const char *name);

/*
 * Delete files that output_open() made in a folder, oldest numbers first, until all that are left have `most` bytes or
 * less; a line for each says so. 0 or -errno: a file cannot be deleted, and those after it were not.
 */
int output_keep(const struct output *output, uint64_t most);

#endif
