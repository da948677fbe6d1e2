/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Names on the network, by ROS 2's rules. */
#ifndef DDXCATALOG_NAME_H
#define DDXCATALOG_NAME_H

#include <stdbool.h>
#include <stdint.h>

#define NAME_TOPIC 160  /* bytes of "rt/carol/gps", with the 0 byte */
#define NAME_TYPE 200   /* of "ddx::msg::dds_::GPS_" */
#define NAME_MACHINE 33 /* of a machine's name: leaves space for an item's name after it */

/* Whether a machine can have this name: letters, digits, '-' and '_', as in host names; at most NAME_MACHINE - 1. */
bool name_is_machine(const char *name);

/* Whether ROS allows this topic: "/imu/data"; at most NAME_TOPIC - 4 letters. */
bool name_is_topic(const char *topic);

/* Whether the topics of two machines would have the same names: "carol-1" and "carol_1". */
bool name_meets(const char *machine, const char *other);

/* "carol-3fa9", for one of two machines with the name carol. */
void name_distinguish(const char *machine, uint64_t id, char name[NAME_MACHINE]);

/* "carol", "video.frame": "rt/carol/video_frame". */
void name_topic(const char *machine, const char *item, char topic[NAME_TOPIC]);

/* "rt/carol/a_b", 2: "rt/carol/a_b_2"; for "rt/carol/a_" and "rt/carol/a" alike: "rt/carol/a_2". */
void name_number(const char *topic, unsigned number, char numbered[NAME_TOPIC]);

/* "ddx/SENSOR": "ddx::msg::dds_::SENSOR_". */
void name_type(const char *type, char name[NAME_TYPE]);

#endif
