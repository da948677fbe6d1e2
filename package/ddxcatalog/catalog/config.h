/* SPDX-License-Identifier: GPL-2.0-or-later */
/* exports.conf: the items that other machines may read, and the network. */
#ifndef DDXCATALOG_CONFIG_H
#define DDXCATALOG_CONFIG_H

#include <bucket.h>
#include <config_file.h>
#include <network.h>
#include <stdbool.h>

#define CONFIG_RULES_MAX 256
#define CONFIG_ACCEPTS_MAX 32

struct config_rule {
    char *pattern;
    bool except, plain; /* do not export these items; a name, not a pattern */
    bool latched;       /* DDS keeps the newest value for later readers */
    char *as, *topic;   /* "sensor_msgs/msg/Imu", "/imu/data": also sent as a standard message; or NULL */
    int64_t period;     /* minimum ns between two values; 0: every value is sent */
};

/* Programs of other machines may write this item, with standard messages on this topic. */
struct config_accept {
    char *topic, *item, *as;
};

struct config {
    struct network_options network; /* its texts are freed with the config */
    struct config_rule rules[CONFIG_RULES_MAX];
    struct config_accept accepts[CONFIG_ACCEPTS_MAX];
    unsigned rule_count, peer_count, accept_count;
    uint64_t bandwidth; /* bytes a second; 0: no limit */
};

/* `path` NULL: export everything except pictures. 0, or -1 and one line in error[CONFIG_ERROR_MAX]. */
int config_read(const char *path, struct config *config, char *error);
void config_free(struct config *config);

/*
 * The first rule that matches; without rules one for each item. NULL: other machines may not read the item. A pattern
 * does not mean pictures, only a name does. Never: what came from other machines ("carol:gps"), and requests.
 */
const struct config_rule *config_rule_of(const struct config *config, const char *item, const char *type);

#endif
