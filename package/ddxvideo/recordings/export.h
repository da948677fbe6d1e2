/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_EXPORT_H
#define DDXVIDEO_EXPORT_H

#include "find.h"

/*
 * Copy the chosen files, which have their names, into a folder. Each is written under another name, synced, read back
 * from the medium, compared, and only then gets its own; a file of that name is replaced. Nothing is written when there
 * is no room for all. Says what it does, and what went wrong. The exit status.
 */
int export_files(const struct folder *folder, const bool *chosen, const char *to);

#endif
