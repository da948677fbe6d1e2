/* SPDX-License-Identifier: GPL-2.0-or-later */
/* exports.conf: which items other machines may read, and by which network. */
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
    bool except, plain; /* not these; a name, no pattern */
    bool latched;       /* DDS keeps the newest value for readers that ask for such */
    char *as, *topic;   /* "sensor_msgs/msg/Imu", "/imu/data": a message of ROS's, too; or NULL */
    int64_t period;     /* ns from one value to the next at least; 0: every value is sent */
};

/* Programs of other machines may write this item, by messages of ROS's on this topic. */
struct config_accept {
    char *topic, *item, *as;
};

struct config {
    struct network_options network; /* its texts are the config's */
    struct config_rule rules[CONFIG_RULES_MAX];
    struct config_accept accepts[CONFIG_ACCEPTS_MAX];
    unsigned rule_count, peer_count, accept_count;
    uint64_t bandwidth; /* bytes a second; 0: no limit */
};

/* NULL: no file, which is everything but pictures. 0, or -1 and one line in error[CONFIG_ERROR_MAX]. */
int config_read(const char *path, struct config *config, char *error);
void config_free(struct config *config);

/*
 * The first rule that matches; without rules one for each item. NULL: other machines may not read the item. A pattern
 * does not mean pictures, only a name does. Never: what came from other machines ("carol:gps"), and requests.
 */
const struct config_rule *config_rule_of(const struct config *config, const char *item, const char *type);

#endif
