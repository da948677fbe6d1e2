/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Selects the socket of a frame grabber, and the television standard. */
#ifndef DDXVIDEO_INPUT_H
#define DDXVIDEO_INPUT_H

#include <linux/videodev2.h>
#include <stdbool.h>
#include <stddef.h>

/* "PAL", "NTSC", "SECAM" in any case; false: another name. */
bool input_parse_standard(const char *text, v4l2_std_id *standard);

/* Whether a camera's input is meant by `text`: its number, its name, or how its name begins, in any case. */
bool input_is_meant(const struct v4l2_input *input, const char *text);

/* Select both; NULL: no change (the standard: that of the signal, if it can be detected). Errors as device_open(). */
int input_select(int fd, const char *input, const char *standard, char *why, size_t size);

#endif
