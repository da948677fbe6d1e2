/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "key_file.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <libavutil/base64.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FILE_MAX 128 /* bytes that are read: more than both forms need */

static const char base64[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
static const char hex[] = "0123456789abcdef";

__attribute__((format(printf, 2, 3))) static bool wrong(char *error, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(error, KEY_FILE_ERROR_MAX, format, arguments);
    va_end(arguments);
    return false;
}

/* Whether only the caller and root can read or change the file. */
static bool check(int fd, const char *path, char *error) {
    struct stat file;

    if (fstat(fd, &file))
        return wrong(error, "%.200s: %s", path, strerror(errno));
    unsigned mode = file.st_mode & 07777;
    if (!S_ISREG(file.st_mode))
        return wrong(error, "%.200s: not a regular file; a key file is needed", path);
    if (file.st_uid != geteuid() && file.st_uid != 0)
        return wrong(error, "%.200s: belongs to user %u; a key file must belong to user %u or to root", path,
                     (unsigned)file.st_uid, (unsigned)geteuid());
    if (mode != 0600 && mode != 0400)
        return wrong(error, "%.200s: mode %03o; a key file must have mode 600: chmod 600 %.200s", path, mode, path);
    return true;
}

static ssize_t read_all(int fd, char *text, size_t size) {
    size_t length = 0;
    ssize_t part;

    while (length < size && (part = read(fd, text + length, size - length)) != 0) {
        if (part < 0 && errno != EINTR)
            return -1;
        length += part > 0 ? (size_t)part : 0;
    }
    return (ssize_t)length;
}

/* Digits of `bits` bits each, the highest first, to bytes. */
static bool decode(const char *text, size_t length, const char *digits, unsigned bits, uint8_t *to) {
    unsigned group = 0, filled = 0;

    for (size_t i = 0; i < length; i++) {
        const char *digit = text[i] ? strchr(digits, text[i]) : NULL;

        if (!digit)
            return false;
        group = group << bits | (unsigned)(digit - digits);
        filled += bits;
        if (filled >= 8) {
            filled -= 8;
            *to++ = (uint8_t)(group >> filled);
            group &= (1u << filled) - 1;
        }
    }
    return true;
}

static bool parse(char *text, size_t length, uint8_t *key) {
    while (length && isspace((unsigned char)text[length - 1]))
        length--;
    if (length == KEY_FILE_TEXT)
        return decode(text, length, base64, 6, key);
    if (length != 2 * KEY_FILE_BYTES)
        return false;
    for (size_t i = 0; i < length; i++)
        text[i] = (char)tolower((unsigned char)text[i]);
    return decode(text, length, hex, 4, key);
}

static bool read_open(int fd, const char *path, uint8_t *key, char *error) {
    char text[FILE_MAX];

    if (!check(fd, path, error))
        return false;
    ssize_t length = read_all(fd, text, sizeof text);
    if (length < 0)
        return wrong(error, "%.200s: %s", path, strerror(errno));
    bool good = parse(text, (size_t)length, key);
    explicit_bzero(text, sizeof text);
    return good || wrong(error,
                         "%.200s: not a key; one line is needed with 30 bytes as base64 (40 digits) or as 60 "
                         "hexadecimal digits: head -c 30 /dev/urandom | base64",
                         path);
}

bool key_file_read(const char *path, uint8_t key[KEY_FILE_BYTES], char *error) {
    /* O_NONBLOCK: a pipe without a writer must not stop the program. */
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY);

    if (fd < 0 && errno == ELOOP)
        return wrong(error, "%.200s: a symbolic link; the key file itself must be named", path);
    if (fd < 0)
        return wrong(error, "%.200s: %s; a key file is needed", path, strerror(errno));
    bool good = read_open(fd, path, key, error);
    close(fd);
    return good;
}

void key_file_text(const uint8_t key[KEY_FILE_BYTES], char text[KEY_FILE_TEXT + 1]) {
    av_base64_encode(text, KEY_FILE_TEXT + 1, key, KEY_FILE_BYTES);
}
