/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Destination of recordings: one named file, or a folder with a new file for each recording. */
#ifndef DDX_OUTPUT_H
#define DDX_OUTPUT_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

struct output {
    const char *place;     /* path as given by the user */
    const char *name;      /* item's name, for names of files in a folder */
    const char *extension; /* for names of files in a folder: "y4m" */
    bool is_folder;
    bool keep; /* an existing named file is a former recording: use the next free name instead */
};

/* Check the place; 0, or -errno if recording there is not possible. */
int output_check(struct output *output, const char *place, const char *name, const char *extension);

/*
 * Open the next file; its path goes into path[PATH_MAX]. In a folder its name is <name>-<NNNNNN>-<UTC>.<extension>,
 * with a number above all existing ones: recordings keep their order and are not overwritten, even if the clock is
 * wrong. A named file is truncated, or with `keep` the next free name of FILE, FILE-2, FILE-3 ... (before the
 * extension) is used; `-` is standard output. For a pipe, waits until it has a reader. A file is locked while it is
 * open. Returns the file descriptor or -errno: -EWOULDBLOCK, another program records into it; -ECANCELED, a request to
 * stop came before the pipe had a reader.
 */
int output_open(const struct output *output, char *path);

/* Write the folder of the files to folder[PATH_MAX]. */
void output_folder(const struct output *output, char *folder);

/* Write the names of new files to the disk. 0 or -EIO; other errors are ignored: some file systems cannot do it. */
int output_sync(const struct output *output);

/* The number in the name of a file made by output_open() in a folder; 0 for any other name. */
long output_number(const struct output *output, const char *name);

/*
 * Delete files made by output_open() in a folder, lowest numbers first, until the rest have `most` bytes or less; logs
 * a line for each. 0, or -errno: a file cannot be deleted, and later ones were not.
 */
int output_keep(const struct output *output, uint64_t most);

#endif
