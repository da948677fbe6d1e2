/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Configuration files (logger.conf, exports.conf): lines of words; `#` begins a comment. */
#ifndef DDX_CONFIG_FILE_H
#define DDX_CONFIG_FILE_H

#define CONFIG_ERROR_MAX 256

struct config_file {
    const char *path;
    char *error;   /* of CONFIG_ERROR_MAX bytes: "FILE:LINE: what is wrong; what is allowed" */
    unsigned line; /* being read, from 1; 0 at first */
};

/* Write the reason to file->error, without control characters. Returns -1. */
__attribute__((format(printf, 2, 3))) int config_wrong(const struct config_file *file, const char *format, ...);

typedef int config_read_line(const struct config_file *file, char **words, void *argument);

/*
 * Call `read` for each line that has words: words[0] is the first, NULL follows the last; they are valid until `read`
 * returns. Stops when `read` does not return 0. 0, or -1 with the reason in file->error.
 */
int config_file_read(struct config_file *file, config_read_line *read, void *argument);

/* The value, if the word is "key=value", else NULL. */
const char *config_value(const char *word, const char *key);

#endif
