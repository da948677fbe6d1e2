/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_SHOW_H
#define DDXVIDEO_SHOW_H

#include "find.h"

/* The number of files of a recording; they follow each other in folder->file from `first` on. */
unsigned show_count(const struct folder *folder, unsigned first);

/* "video-000012"; for a file without a number, its name. */
void show_name(const struct found *found, char name[NAME_MAX + 1]);

/* Print a line for each recording, oldest first. */
void show_recordings(const struct folder *folder, bool json);

/* Print a line on the room left on the disk. */
void show_room(const struct folder *folder, const char *path);

#endif
