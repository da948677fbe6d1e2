/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The file with the key of an encrypted stream. One line: master key (16 bytes) and master salt (14 bytes) of
 * AES_CM_128_HMAC_SHA1_80 (RFC 3711), as 40 digits of base64 (as in RFC 4568) or 60 hexadecimal digits. To create one:
 *
 *     (umask 077 && head -c 30 /dev/urandom | base64 > FILE)
 *
 * It must be a regular file of mode 600 or 400 that belongs to the caller or to root. No link is followed.
 */
#ifndef DDXVIDEO_KEY_FILE_H
#define DDXVIDEO_KEY_FILE_H

#include <stdbool.h>
#include <stdint.h>

#define KEY_FILE_BYTES 30
#define KEY_FILE_TEXT 40 /* digits of base64 */
#define KEY_FILE_ERROR_MAX 500

/* Read the key of a file. False, with one line about the file in error[KEY_FILE_ERROR_MAX], if it has none. */
bool key_file_read(const char *path, uint8_t key[KEY_FILE_BYTES], char *error);

/* The key in base64. */
void key_file_text(const uint8_t key[KEY_FILE_BYTES], char text[KEY_FILE_TEXT + 1]);

#endif
