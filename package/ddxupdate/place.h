/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The machine: its files, and how it was booted; and messages for people. */
#ifndef DDXUPDATE_PLACE_H
#define DDXUPDATE_PLACE_H

#include <limits.h>
#include <stdbool.h>

enum { WORD_MAX = 64 };

struct place {
    const char *root; /* comes before all paths; empty on a machine, a folder in tests */
    char block_lock[PATH_MAX], lock[PATH_MAX], wrong[PATH_MAX], failed[PATH_MAX], state[PATH_MAX], mount[PATH_MAX],
        release[PATH_MAX], keys[PATH_MAX], progress[PATH_MAX], rules[PATH_MAX]; /* paths */
    char here;              /* 'A' or 'B': the running slot; 0 if another loader started the machine */
    char counted[WORD_MAX]; /* "begun=1": how the loader has counted this boot */
    char layout[WORD_MAX];  /* of the disk, as GRUB's menu has passed it; empty if the card's menu is older */
};

/* `root` must stay valid. */
void place_find(struct place *place, const char *root);

/* The path of a file of the machine, such as "/run/service". */
void place_path(const struct place *place, const char *name, char path[PATH_MAX]);

/* Read a file's first line without its end, at most size - 1 bytes. False, and an empty text: it cannot be read. */
bool place_line(const char *path, char *text, int size);

/* Write a line to a new file, or to one that it replaces. */
void place_note(const char *path, const char *text);

/* The value in a line NAME=VALUE, up to the end of the text, if it is that of this name; else NULL. */
const char *line_value(const char *line, const char *name);

/* One line to stderr, "ddxupdate: <message>". Returns `result`. */
__attribute__((format(printf, 2, 3))) int fail(int result, const char *format, ...);

#endif
