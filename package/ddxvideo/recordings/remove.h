/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_REMOVE_H
#define DDXVIDEO_REMOVE_H

#include "find.h"

/*
 * Remove the chosen files. If one of them is being recorded, or is held by another program (found_open()), none is
 * removed. Prints a line for each file. Returns the exit status.
 */
int remove_files(const struct folder *folder, const bool *chosen);

#endif
