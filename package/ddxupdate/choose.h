/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The chosen slot in the boot loader's block, for the commands. */
#ifndef DDXUPDATE_CHOOSE_H
#define DDXUPDATE_CHOOSE_H

#include "block.h"
#include "command.h"

/* Read the block; a lost one counts as empty. 0, or the exit status after a line. */
int choose_read(const struct request *request, struct block *block);

/* Replace the block. 0, or the exit status after a line. */
int choose_write(const struct request *request, const struct block *block);

#endif
