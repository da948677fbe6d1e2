/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "config_file.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define LINE_ROOM 1024

int config_wrong(const struct config_file *file, const char *format, ...) {
    char text[CONFIG_ERROR_MAX];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    for (char *c = text; *c; c++) /* the file may have any bytes */
        if ((unsigned char)*c < ' ' || *c == 127)
            *c = '?';
    snprintf(file->error, CONFIG_ERROR_MAX, "%.120s:%u: %.*s", file->path, file->line, CONFIG_ERROR_MAX - 140, text);
    return -1;
}

/* Cut the line into words[], NULL after the last. Returns their number. */
static unsigned split(char *text, char **words) {
    char *rest = text, *comment = strchr(text, '#');
    unsigned count = 0;

    if (comment)
        *comment = 0;
    for (char *word; (word = strtok_r(rest, " \t\r\n", &rest));)
        words[count++] = word;
    words[count] = NULL;
    return count;
}

int config_file_read(struct config_file *file, config_read_line *read, void *argument) {
    char text[LINE_ROOM], *words[LINE_ROOM / 2 + 1];
    int result = 0;
    FILE *from = fopen(file->path, "re");

    if (!from) {
        snprintf(file->error, CONFIG_ERROR_MAX, "%.120s: %s", file->path, strerror(errno));
        return -1;
    }
    while (!result && fgets(text, sizeof text, from)) {
        file->line++;
        if (strlen(text) == sizeof text - 1 && text[sizeof text - 2] != '\n')
            result = config_wrong(file, "longer than %d letters", LINE_ROOM - 2);
        else if (split(text, words))
            result = read(file, words, argument);
    }
    if (!result && ferror(from))
        result = config_wrong(file, "%s", strerror(errno));
    fclose(from);
    return result;
}

const char *config_value(const char *word, const char *key) {
    size_t length = strlen(key);

    return !strncmp(word, key, length) && word[length] == '=' ? word + length + 1 : NULL;
}
