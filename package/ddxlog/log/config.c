/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "config.h"

#include <ddx.h>
#include <errno.h>
#include <fnmatch.h>
#include <schedule.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_time.h"

#define MIB ((uint64_t)1 << 20)

/* "256M"; false if the text is not a size within the bounds. */
static bool parse_size(const char *text, uint64_t least, uint64_t most, uint64_t *size) {
    char *end;

    if (*text < '0' || *text > '9')
        return false;
    errno = 0;
    unsigned long long number = strtoull(text, &end, 10);
    unsigned shift = *end == 'K' ? 10 : *end == 'M' ? 20 : *end == 'G' ? 30 : 0;
    if (errno || !shift || end[1] || number > (UINT64_MAX >> shift))
        return false;
    *size = (uint64_t)number << shift;
    return *size >= least && *size <= most;
}

static int read_output(const struct config_file *line, char **words, struct config *config) {
    if (!words[1])
        return config_wrong(line, "output needs a folder: output /rec/log [segment=256M] [minutes=60] [keep=4G]");
    if (config->folder)
        return config_wrong(line, "a second output; only one is allowed");
    if (!(config->folder = strdup(words[1])))
        return config_wrong(line, "no memory");
    for (words += 2; *words; words++) {
        const char *segment = config_value(*words, "segment"), *minutes = config_value(*words, "minutes");
        const char *keep = config_value(*words, "keep");
        char *end;

        if (segment && !parse_size(segment, MIB, 4096 * MIB, &config->segment))
            return config_wrong(line, "%s: a size from 1M to 4096M is allowed, with K, M or G", *words);
        if (minutes) {
            long number = strtol(minutes, &end, 10);

            if (*minutes < '0' || *minutes > '9' || *end || number < 1 || number > 1440)
                return config_wrong(line, "%s: a whole number from 1 to 1440 is allowed", *words);
            config->age = number * 60 * SECOND;
        }
        if (keep && !parse_size(keep, 2 * MIB, UINT64_MAX, &config->keep))
            return config_wrong(line, "%s: a size of 2M or more is allowed, with K, M or G", *words);
        if (!segment && !minutes && !keep)
            return config_wrong(line, "%s: after output FOLDER, segment=, minutes= and keep= are allowed", *words);
    }
    if (config->keep && config->keep < 2 * config->segment)
        return config_wrong(line, "keep= needs room for two files of segment= (default 256M) at least");
    return 0;
}

static int read_queue(const struct config_file *line, char **words, struct config *config) {
    if (!words[1] || words[2] || !parse_size(words[1], 64 << 10, 1024 * MIB, &config->queue))
        return config_wrong(line, "queue needs a size from 64K to 1024M, with K, M or G: queue 4M");
    return 0;
}

static int read_rule(const struct config_file *line, char **words, struct config *config) {
    struct config_rule rule = {.except = !strcmp(words[0], "except")};

    if (!words[1])
        return config_wrong(line, "%s needs the name of an item, or a pattern: %s gps*", words[0], words[0]);
    if (strlen(words[1]) > DDX_NAME_MAX)
        return config_wrong(line, "%.20s...: an item's name has %d letters at most", words[1], DDX_NAME_MAX);
    for (char **word = words + 2; *word; word++) {
        const char *rate = rule.except ? NULL : config_value(*word, "rate");
        struct schedule_speed speed;

        if (!rate)
            return config_wrong(line, "%s: after %s PATTERN, %s is allowed", *word, words[0],
                                rule.except ? "nothing more" : "rate=VALUES_A_SECOND");
        if (!schedule_parse_speed(rate, &speed) || !speed.num)
            return config_wrong(
                line, "%s: a number above 0, up to 1000, is allowed; without rate= every value is logged", *word);
        rule.period = schedule_scale(SECOND, speed.den, speed.num);
    }
    if (config->rule_count == CONFIG_RULES_MAX)
        return config_wrong(line, "more than %d lines of items", CONFIG_RULES_MAX);
    rule.plain = !strpbrk(words[1], "*?[");
    if (!(rule.pattern = strdup(words[1])))
        return config_wrong(line, "no memory");
    config->rules[config->rule_count++] = rule;
    return 0;
}

static int read_words(const struct config_file *line, char **words, void *argument) {
    struct config *config = argument;

    if (!strcmp(words[0], "item") || !strcmp(words[0], "except"))
        return read_rule(line, words, config);
    if (!strcmp(words[0], "output"))
        return read_output(line, words, config);
    if (!strcmp(words[0], "queue"))
        return read_queue(line, words, config);
    return config_wrong(line, "%s: a line begins with item, except, output or queue", words[0]);
}

/* Checks and defaults after the last line. */
static int complete(struct config_file *file, struct config *config) {
    file->line++;
    for (unsigned i = 0; i < config->rule_count; i++)
        if (!config->rules[i].except)
            return config->folder || (config->folder = strdup(".")) ? 0 : config_wrong(file, "no memory");
    return config_wrong(file, "no line says what to log: item NAME");
}

int config_read(const char *path, struct config *config, char *error) {
    struct config_file file = {.path = path, .error = error};

    *config = (struct config){.segment = 256 * MIB, .age = 60 * 60 * SECOND, .queue = 4 * MIB};
    int result = config_file_read(&file, read_words, config);
    if (!result)
        result = complete(&file, config);
    if (result)
        config_free(config);
    return result;
}

void config_free(struct config *config) {
    for (unsigned i = 0; i < config->rule_count; i++)
        free(config->rules[i].pattern);
    free(config->folder);
    *config = (struct config){.folder = NULL};
}

const struct config_rule *config_rule_for(const struct config *config, const char *item, const char *type) {
    for (unsigned i = 0; i < config->rule_count; i++) {
        const struct config_rule *rule = &config->rules[i];

        if (fnmatch(rule->pattern, item, 0))
            continue;
        if (!rule->except && !rule->plain && !strcmp(type, "DDX_VIDEO"))
            continue;
        return rule->except ? NULL : rule;
    }
    return NULL;
}
