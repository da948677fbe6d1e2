/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Which socket of a frame grabber, and which television standard. */
#ifndef DDXVIDEO_INPUT_H
#define DDXVIDEO_INPUT_H

#include <linux/videodev2.h>
#include <stdbool.h>
#include <stddef.h>

/* "PAL", "NTSC", "SECAM" in any case; false if it is no such name. */
bool input_parse_standard(const char *text, v4l2_std_id *standard);

/* Whether a camera's input is meant by `text`: its number, its name, or how its name begins, in any case. */
bool input_is_meant(const struct v4l2_input *input, const char *text);

/* Select them; NULL leaves it (the standard: takes what is on the line, where that can be told). As device_open(). */
int input_select(int fd, const char *input, const char *standard, char *why, size_t size);

#endif
