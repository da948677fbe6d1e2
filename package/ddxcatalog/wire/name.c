/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "name.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

bool name_is_machine(const char *name) {
    size_t length = strnlen(name, NAME_MACHINE);

    for (size_t i = 0; i < length; i++)
        if (!isalnum((unsigned char)name[i]) && name[i] != '-' && name[i] != '_')
            return false;
    return length > 0 && length < NAME_MACHINE;
}

bool name_is_topic(const char *topic) {
    size_t length = strnlen(topic, NAME_TOPIC);

    for (size_t i = 0; i < length; i++) {
        char before = i ? topic[i - 1] : 0, c = topic[i];
        bool good = !i || before == '/' ? isalpha((unsigned char)c) || (c == '_' && i)
                                        : isalnum((unsigned char)c) || c == '/' || (c == '_' && before != '_');

        if (i ? !good : c != '/')
            return false;
    }
    return length > 1 && length < NAME_TOPIC - 3 && topic[length - 1] != '/';
}

/* A part between slashes: letters, digits and single underscores, no digit first. */
static void add_part(char topic[NAME_TOPIC], const char *part) {
    size_t length = strlen(topic);

    topic[length++] = '/';
    if (!isalpha((unsigned char)*part))
        topic[length++] = 'n';
    for (; *part && length < NAME_TOPIC - 1; part++)
        if (isalnum((unsigned char)*part))
            topic[length++] = *part;
        else if (topic[length - 1] != '_')
            topic[length++] = '_';
    topic[length] = 0;
}

void name_topic(const char *machine, const char *item, char topic[NAME_TOPIC]) {
    strcpy(topic, "rt");
    add_part(topic, machine);
    add_part(topic, item);
}

void name_number(const char *topic, unsigned number, char numbered[NAME_TOPIC]) {
    int length = (int)strnlen(topic, NAME_TOPIC - 12);

    while (topic[length - 1] == '_') /* ROS has no topics with two underscores in a row */
        length--;
    snprintf(numbered, NAME_TOPIC, "%.*s_%u", length, topic, number);
}

bool name_meets(const char *machine, const char *other) {
    char topics[2][NAME_TOPIC];

    name_topic(machine, "x", topics[0]);
    name_topic(other, "x", topics[1]);
    return !strcmp(topics[0], topics[1]);
}

void name_distinguish(const char *machine, uint64_t id, char name[NAME_MACHINE]) {
    snprintf(name, NAME_MACHINE, "%.*s-%04x", NAME_MACHINE - 6, machine, (unsigned)(id & 0xffff));
}

void name_type(const char *type, char name[NAME_TYPE]) {
    size_t package = strcspn(type, "/");

    snprintf(name, NAME_TYPE, "%.*s::msg::dds_::%s_", (int)package, type, type[package] ? type + package + 1 : "");
}
