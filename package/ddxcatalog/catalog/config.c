/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "config.h"

#include <ddx.h>
#include <ddx_time.h>
#include <fnmatch.h>
#include <name.h>
#include <schedule.h>
#include <standard.h>
#include <stdlib.h>
#include <string.h>

#define DOMAIN_MAX 232 /* above, ports of DDS would be above 65535 */

static int read_rate(const struct config_file *line, const char *word, const char *rate, struct config_rule *rule) {
    struct schedule_speed speed;

    if (!schedule_parse_speed(rate, &speed) || !speed.num)
        return config_wrong(line, "%s: a number above 0, up to 1000, is allowed; without rate= every value is sent",
                            word);
    rule->period = schedule_scale(SECOND, speed.den, speed.num);
    return 0;
}

/* A word is set once. */
static int keep_text(const struct config_file *line, const char *word, const char *text, char **place) {
    if (*place)
        return config_wrong(line, "%s: once in a line only", word);
    *place = strdup(text);
    return *place ? 0 : config_wrong(line, "no memory");
}

static int read_as(const struct config_file *line, const char *word, const char *type, char **place) {
    struct standard *standard;
    char why[STANDARD_WHY];
    int error = standard_open(type, NULL, &standard, why);

    if (error)
        return config_wrong(line, "%s: not a known message; docs/catalog.md lists them", word);
    standard_close(standard);
    return keep_text(line, word, type, place);
}

static int read_topic(const struct config_file *line, const char *word, const char *topic, char **place) {
    if (!name_is_topic(topic))
        return config_wrong(line, "%s: /NAME is needed, or /NAME/NAME, of letters, digits and '_'", word);
    return keep_text(line, word, topic, place);
}

static int read_choice(const struct config_file *line, const char *word, struct config_rule *rule) {
    const char *text;

    if (rule->except)
        return config_wrong(line, "%s: after except PATTERN, nothing more is allowed", word);
    if ((text = config_value(word, "rate")))
        return read_rate(line, word, text, rule);
    if ((text = config_value(word, "as")))
        return read_as(line, word, text, &rule->as);
    if ((text = config_value(word, "topic")))
        return read_topic(line, word, text, &rule->topic);
    if (strcmp(word, "latched"))
        return config_wrong(line,
                            "%s: after item PATTERN, rate=VALUES_A_SECOND, latched, and as=MESSAGE with "
                            "topic=TOPIC are allowed",
                            word);
    rule->latched = true;
    return 0;
}

static void free_rule(const struct config_rule *rule) {
    free(rule->pattern);
    free(rule->as);
    free(rule->topic);
}

static int read_choices(const struct config_file *line, char **words, struct config_rule *rule) {
    for (char **word = words; *word; word++)
        if (read_choice(line, *word, rule))
            return -1;
    if (!rule->as != !rule->topic)
        return config_wrong(line, "as=MESSAGE and topic=TOPIC are needed together");
    if (rule->as && !rule->plain)
        return config_wrong(line, "as= needs the name of one item, not a pattern");
    return 0;
}

static int read_rule(const struct config_file *line, char **words, struct config *config) {
    struct config_rule rule = {.except = !strcmp(words[0], "except"), .plain = !strpbrk(words[1], "*?[")};

    if (strlen(words[1]) > DDX_NAME_MAX)
        return config_wrong(line, "%.20s...: an item's name has %d letters at most", words[1], DDX_NAME_MAX);
    if (config->rule_count == CONFIG_RULES_MAX)
        return config_wrong(line, "more than %d lines of items", CONFIG_RULES_MAX);
    int error = read_choices(line, words + 2, &rule);
    if (!error && !(rule.pattern = strdup(words[1])))
        error = config_wrong(line, "no memory");
    if (error)
        free_rule(&rule);
    else
        config->rules[config->rule_count++] = rule;
    return error;
}

static void free_accept(const struct config_accept *accept) {
    free(accept->topic);
    free(accept->item);
    free(accept->as);
}

/* "accept /cmd_vel as cmd type=geometry_msgs/msg/Twist" */
static int read_accept(const struct config_file *line, char **words, struct config *config) {
    struct config_accept accept = {.topic = NULL};
    const char *type = words[2] && words[3] && words[4] ? config_value(words[4], "type") : NULL;

    if (!type || words[5] || strcmp(words[2], "as"))
        return config_wrong(line, "accept TOPIC as ITEM type=MESSAGE is needed, such as type=geometry_msgs/msg/Twist");
    if (strlen(words[3]) > DDX_NAME_MAX || strpbrk(words[3], ":/*?["))
        return config_wrong(line, "%.80s: the name of an item of this machine is needed", words[3]);
    if (config->accept_count == CONFIG_ACCEPTS_MAX)
        return config_wrong(line, "more than %d lines of accept", CONFIG_ACCEPTS_MAX);
    int error = read_topic(line, words[1], words[1], &accept.topic);
    if (!error)
        error = read_as(line, words[4], type, &accept.as);
    if (!error)
        error = keep_text(line, words[3], words[3], &accept.item);
    if (error)
        free_accept(&accept);
    else
        config->accepts[config->accept_count++] = accept;
    return error;
}

static int read_interface(const struct config_file *line, char **words, struct config *config) {
    if (config->network.interface)
        return config_wrong(line, "a second interface; only one is allowed");
    config->network.interface = strdup(words[1]);
    return config->network.interface ? 0 : config_wrong(line, "no memory");
}

static int read_peer(const struct config_file *line, char **words, struct config *config) {
    if (config->peer_count == NETWORK_PEERS - 1)
        return config_wrong(line, "more than %d peers", NETWORK_PEERS - 1);
    if (!(config->network.peers[config->peer_count] = strdup(words[1])))
        return config_wrong(line, "no memory");
    config->peer_count++;
    return 0;
}

static int read_domain(const struct config_file *line, char **words, struct config *config) {
    char *end;
    long number = strtol(words[1], &end, 10);

    if (*words[1] < '0' || *words[1] > '9' || *end || number > DOMAIN_MAX)
        return config_wrong(line, "domain %s: a whole number from 0 to %d is allowed", words[1], DOMAIN_MAX);
    config->network.domain = (unsigned)number;
    return 0;
}

static int read_multicast(const struct config_file *line, char **words, struct config *config) {
    config->network.unicast = !strcmp(words[1], "no");
    if (config->network.unicast || !strcmp(words[1], "auto"))
        return 0;
    return config_wrong(line, "multicast %s: auto or no is allowed", words[1]);
}

static int read_bandwidth(const struct config_file *line, char **words, struct config *config) {
    const char *text = words[1];
    char *end;
    unsigned long long number = *text < '0' || *text > '9' ? 0 : strtoull(text, &end, 10);
    unsigned shift = !number ? 0 : *end == 'K' ? 10 : *end == 'M' ? 20 : 0;

    if (!shift || end[1] || number > BUCKET_MOST >> shift)
        return config_wrong(line, "bandwidth %s: bytes a second are needed, from 1K to 1024M, with K or M", text);
    config->bandwidth = (uint64_t)number << shift;
    return 0;
}

static const struct {
    const char *word;
    int (*read)(const struct config_file *line, char **words, struct config *config);
    bool more; /* more than one word may follow */
} readers[] = {{"item", read_rule, true},
               {"except", read_rule, true},
               {"accept", read_accept, true},
               {"interface", read_interface, false},
               {"peer", read_peer, false},
               {"domain", read_domain, false},
               {"multicast", read_multicast, false},
               {"bandwidth", read_bandwidth, false}};

static int read_words(const struct config_file *line, char **words, void *argument) {
    struct config *config = argument;

    for (size_t i = 0; i < sizeof readers / sizeof *readers; i++)
        if (!strcmp(words[0], readers[i].word))
            return words[1] && (!words[2] || readers[i].more)
                       ? readers[i].read(line, words, config)
                       : config_wrong(line, "after %s, one word is needed", words[0]);
    return config_wrong(line,
                        "%s: a line begins with item, except, accept, interface, peer, domain, multicast or "
                        "bandwidth",
                        words[0]);
}

int config_read(const char *path, struct config *config, char *error) {
    struct config_file file = {.path = path, .error = error};

    *config = (struct config){.rule_count = 0};
    if (!path)
        return 0;
    int result = config_file_read(&file, read_words, config);
    if (result)
        config_free(config);
    return result;
}

void config_free(struct config *config) {
    for (unsigned i = 0; i < config->rule_count; i++)
        free_rule(&config->rules[i]);
    for (unsigned i = 0; i < config->accept_count; i++)
        free_accept(&config->accepts[i]);
    for (unsigned i = 0; i < config->peer_count; i++)
        free((char *)config->network.peers[i]);
    free((char *)config->network.interface);
    *config = (struct config){.rule_count = 0};
}

static bool ends_with(const char *text, const char *end) {
    size_t length = strlen(text), last = strlen(end);

    return length >= last && !strcmp(text + length - last, end);
}

const struct config_rule *config_rule_of(const struct config *config, const char *item, const char *type) {
    static const struct config_rule plain = {.pattern = NULL};
    bool picture = !strcmp(type, "DDX_VIDEO");

    if (strchr(item, ':') || ends_with(item, ".request") || ends_with(item, ".answer"))
        return NULL;
    for (unsigned i = 0; i < config->rule_count; i++) {
        const struct config_rule *rule = &config->rules[i];

        if (!fnmatch(rule->pattern, item, 0) && (rule->except || rule->plain || !picture))
            return rule->except ? NULL : rule;
    }
    return !config->rule_count && !picture ? &plain : NULL;
}
