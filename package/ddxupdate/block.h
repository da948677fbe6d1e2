/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The contents of the boot loader's environment block: its variables, which board/common/grub.cfg describes. */
#ifndef DDXUPDATE_BLOCK_H
#define DDXUPDATE_BLOCK_H

#include <stdbool.h>

enum {
    BLOCK_SIZE = 1024
}; /* bytes; all variables are in the first sector, so a power cut leaves the old or new ones */

struct block {
    char slot;   /* 'A' or 'B': the chosen slot */
    char left;   /* '0' to '9', 0 if not set */
    char begun;  /* the same */
    char failed; /* 'A', 'B', or 0 */
};

/* Read the variables. False: this is no block of the boot loader's, which then boots slot A and counts nothing. */
bool block_parse(const char text[BLOCK_SIZE], struct block *block);

void block_format(const struct block *block, char text[BLOCK_SIZE]);

/* Whether the block has this line, such as "begun=1": the loader's own report of how it counted the boot. */
bool block_has(const struct block *block, const char *line);

/* Report that slot `here` has come up. */
void block_came_up(struct block *block, char here);

/* Whether slot `here`, which runs, is the chosen one and on trial. */
bool block_is_trial(const struct block *block, char here);

/* The slot besides this one. */
char block_other(char slot);

#endif
