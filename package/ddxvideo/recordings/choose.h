/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXVIDEO_CHOOSE_H
#define DDXVIDEO_CHOOSE_H

#include "find.h"

/*
 * Set chosen[], which has an entry for each file, for a word: "all", "newest" (the newest recording), a recording
 * (video-000012, or its number alone), or a file's name. False: the word stands for no file. Prints nothing.
 */
bool choose_files(const struct folder *folder, const char *word, bool *chosen);

#endif
