/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_CHOOSE_H
#define DDXVIDEO_CHOOSE_H

#include "find.h"

/*
 * Which files are meant by a word: "all", "newest" (the newest recording), a recording (video-000012, or its number
 * alone), or a file's name. chosen[] has an entry for each file. False: none, which is not said.
 */
bool choose_files(const struct folder *folder, const char *word, bool *chosen);

#endif
