/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "secret.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>

int secret_make(char text[SECRET_TEXT + 1]) {
    unsigned char bytes[SECRET_BYTES];

    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return -EIO;
    for (size_t i = 0; i < SECRET_BYTES; i++)
        snprintf(text + 2 * i, 3, "%02x", bytes[i]);
    explicit_bzero(bytes, sizeof bytes);
    return 0;
}

bool secret_is(const char *secret, const char *text) {
    size_t length = strlen(secret), length_text = strlen(text);
    unsigned char difference = length != length_text;

    for (size_t i = 0; i < length_text; i++)
        difference |= (unsigned char)(secret[length ? i % length : 0] ^ text[i]);
    return !difference;
}
