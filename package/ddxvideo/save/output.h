/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Where recordings go: one named file, or a folder that gets a new file for each. */
#ifndef DDXVIDEO_OUTPUT_H
#define DDXVIDEO_OUTPUT_H

#include <limits.h>
#include <stdbool.h>

struct output {
    const char *place; /* as given */
    const char *name;  /* of the item, for names of files in a folder */
    bool is_folder;
};

/* Look at the place; 0 or -errno if nothing could be recorded there. */
int output_check(struct output *output, const char *place, const char *name);

/*
 * Open the next file; its path into path[PATH_MAX]. In a folder it is called <name>-<NNNNNN>-<UTC>.y4m, with a
 * number above all that are there: recordings keep their order, and are not overwritten, however wrong the clock
 * is. Returns the file descriptor or -errno.
 */
int output_open(const struct output *output, char *path);

#endif
