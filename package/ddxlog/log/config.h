/* SPDX-License-Identifier: GPL-2.0-or-later */
/* logger.conf: items to log, and the destination. docs/logging.md has the syntax. */
#ifndef DDXLOG_CONFIG_H
#define DDXLOG_CONFIG_H

#include <config_file.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CONFIG_RULES_MAX 256

struct config_rule {
    char *pattern;  /* an item's name, or a shell pattern */
    bool except;    /* do not log these items */
    bool plain;     /* a name, not a pattern */
    int64_t period; /* minimum ns between two values; 0: every value */
};

struct config {
    char *folder;
    uint64_t segment; /* approximate bytes of a file */
    uint64_t keep;    /* bytes of all files; older ones are deleted; 0: no limit */
    int64_t age;      /* maximum ns from a file's begin to its end */
    uint64_t queue;   /* bytes of the queue between store and disk */
    struct config_rule rules[CONFIG_RULES_MAX];
    unsigned rule_count;
};

/* Read a file. 0, or -1 and "FILE:LINE: what is wrong; what is allowed" in error[CONFIG_ERROR_MAX]. */
int config_read(const char *path, struct config *config, char *error);
void config_free(struct config *config);

/*
 * The rule for an item: the first one that matches decides. NULL: the item is not logged. Pictures (`type` DDX_VIDEO)
 * are recorded by ddxvideosave: they match only a name, not a pattern.
 */
const struct config_rule *config_rule_for(const struct config *config, const char *item, const char *type);

#endif
