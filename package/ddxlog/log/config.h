/* SPDX-License-Identifier: GPL-2.0-or-later */
/* logger.conf: what is logged, and where to. docs/logging.md has the syntax. */
#ifndef DDXLOG_CONFIG_H
#define DDXLOG_CONFIG_H

#include <config_file.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CONFIG_RULES_MAX 256

struct config_rule {
    char *pattern;  /* an item's name, or a shell's pattern for names */
    bool except;    /* not these */
    bool plain;     /* a name, no pattern */
    int64_t period; /* ns between two values at least; 0: every value */
};

struct config {
    char *folder;
    uint64_t segment; /* bytes of a file, about */
    uint64_t keep;    /* bytes of all files; older ones are deleted; 0: no limit */
    int64_t age;      /* ns that a file is written to, at most */
    uint64_t queue;   /* bytes between store and disk */
    struct config_rule rules[CONFIG_RULES_MAX];
    unsigned rule_count;
};

/* Read a file. 0, or -1 and "FILE:LINE: what is wrong; what is allowed" in error[CONFIG_ERROR_MAX]. */
int config_read(const char *path, struct config *config, char *error);
void config_free(struct config *config);

/*
 * The rule for an item: the first one that matches decides. NULL: it is not logged. Pictures (`type` DDX_VIDEO) are
 * ddxvideosave's: a pattern does not mean them, only a name does.
 */
const struct config_rule *config_rule_for(const struct config *config, const char *item, const char *type);

#endif
