/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_SHOW_H
#define DDXVIDEO_SHOW_H

#include "find.h"

/* The files of one recording, which follow each other in folder->file from `first` on: how many. */
unsigned show_count(const struct folder *folder, unsigned first);

/* "video-000012"; of a file without a number its name. */
void show_name(const struct found *found, char name[NAME_MAX + 1]);

/* A line for each recording, oldest first. */
void show_recordings(const struct folder *folder, bool json);

/* A line on what the disk still has room for. */
void show_room(const struct folder *folder, const char *path);

#endif
