/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Texts that a visitor cannot guess, and how what a visitor sends is compared with them. */
#ifndef DDXPANEL_SECRET_H
#define DDXPANEL_SECRET_H

#include <stdbool.h>

#define SECRET_BYTES 16                /* random */
#define SECRET_TEXT (2 * SECRET_BYTES) /* hexadecimal digits, in small letters */

/* Make a new one. 0; -EIO: there are no random numbers. */
int secret_make(char text[SECRET_TEXT + 1]);

/*
 * Whether two texts are the same. The time depends on the lengths only, or a visitor could find a secret character by
 * character.
 */
bool secret_is(const char *secret, const char *text);

#endif
