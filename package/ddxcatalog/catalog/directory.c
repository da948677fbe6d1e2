/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "directory.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define TEXT_MAX 16384 /* bytes of a declaration */

struct directory {
    struct catalog *catalog;
    struct remote *first;
    uint64_t changes, refused;
};

static bool is_item(const char *name) {
    size_t length = strnlen(name, DDX_NAME_MAX + 1);

    for (size_t i = 0; i < length; i++)
        if (!isgraph((unsigned char)name[i]) || (unsigned char)name[i] > '~' || strchr("/:", name[i]))
            return false;
    return length > 0 && length <= DDX_NAME_MAX;
}

static bool is_type(const char *name) {
    size_t length = strnlen(name, DDX_NAME_MAX + 1);

    for (size_t i = 0; i < length; i++)
        if (!isprint((unsigned char)name[i]))
            return false;
    return length > 0 && length <= DDX_NAME_MAX;
}

static bool is_topic(const char *topic) {
    return !strncmp(topic, "rt/", 3) && strnlen(topic, NAME_TOPIC) < NAME_TOPIC;
}

/* Whether there is room for an item of this machine. */
static bool has_room(const struct directory *directory, uint64_t machine) {
    uint64_t machines[MACHINES_MAX];
    unsigned count = 0, items = 0;
    bool known = false;

    for (const struct remote *remote = directory->first; remote; remote = remote->next) {
        unsigned i = 0;

        while (i < count && machines[i] != remote->machine)
            i++;
        if (i == count && count < MACHINES_MAX)
            machines[count++] = remote->machine;
        known |= remote->machine == machine;
        items += remote->machine == machine;
    }
    return (known || count < MACHINES_MAX) && items < ITEMS_MAX;
}

/* What the machine is called here: another one of its name, which was known before, keeps it. */
static void choose_name(const struct directory *directory, struct remote *remote, const char *name) {
    bool taken = !strcmp(name, directory->catalog->machine);

    for (const struct remote *other = directory->first; other; other = other->next) {
        if (other->machine == remote->machine) {
            strcpy(remote->name, other->name);
            return;
        }
        taken |= !strcmp(other->name, name);
    }
    snprintf(remote->name, sizeof remote->name, taken ? "%.*s-%04x" : "%.*s", NAME_MACHINE - 6, name,
             (unsigned)(remote->machine & 0xffff));
}

static void free_remote(struct remote *remote) {
    if (!remote)
        return;
    free(remote->topic);
    free(remote->declaration);
    free(remote->extents);
    form_free(remote->form);
    free(remote);
}

static struct remote **place_of(struct directory *directory, const struct network_record *record) {
    struct remote **at = &directory->first;

    while (*at && ((*at)->machine != record->machine || strcmp((*at)->item, record->item)))
        at = &(*at)->next;
    return at;
}

/* A remote of what the record says; NULL if it cannot be, or there is no memory. */
static struct remote *judged(struct directory *directory, const struct network_record *record) {
    if (!record->item || !record->name || !record->type || !record->declaration || !record->extents ||
        !record->topic || !is_item(record->item) || !name_is_machine(record->name) || !is_type(record->type) ||
        !is_topic(record->topic) || strnlen(record->declaration, TEXT_MAX) == TEXT_MAX ||
        strnlen(record->extents, TEXT_MAX) == TEXT_MAX)
        return NULL;
    struct remote *remote = calloc(1, sizeof *remote);
    if (!remote)
        return NULL;
    remote->machine = record->machine;
    strcpy(remote->item, record->item);
    choose_name(directory, remote, record->name);
    remote->topic = strdup(record->topic);
    remote->declaration = strdup(record->declaration);
    remote->extents = strdup(record->extents);
    if (remote->topic && remote->declaration && remote->extents &&
        !form_of_text(record->type, record->declaration, record->extents, &remote->form) &&
        remote->form->message_size <= MESSAGE_MAX)
        return remote;
    free_remote(remote);
    return NULL;
}

static void put(struct directory *directory, const struct network_record *record) {
    struct remote *remote = judged(directory, record);
    struct remote **at = remote ? place_of(directory, record) : NULL;

    if (!remote || (!*at && !has_room(directory, record->machine))) {
        if (!directory->refused++)
            say("an item of another machine is left out: it has no proper name or type, or there are too many");
        free_remote(remote);
        return;
    }
    struct remote *old = *at;
    remote->next = old ? old->next : NULL;
    remote->version = ++directory->changes;
    if (old && !strcmp(old->form->type, remote->form->type) && !strcmp(old->declaration, remote->declaration) &&
        !strcmp(old->extents, remote->extents) && !strcmp(old->topic, remote->topic))
        remote->version = old->version;
    *at = remote;
    free_remote(old);
}

void directory_take(struct directory *directory, const struct network_record *record, enum network_change change) {
    if (change == NETWORK_THERE) {
        put(directory, record);
        return;
    }
    struct remote **at = record->item ? place_of(directory, record) : NULL;
    if (!at || !*at)
        return;
    struct remote *remote = *at;
    if (change == NETWORK_AWAY) {
        remote->away = true;
    } else {
        *at = remote->next;
        free_remote(remote);
    }
}

int directory_find(const struct directory *directory, const char *name, const struct remote **found) {
    const char *colon = strchr(name, ':');
    bool machine = false;

    if (!colon)
        return -EINVAL;
    for (const struct remote *remote = directory->first; remote; remote = remote->next) {
        if (remote->away || strlen(remote->name) != (size_t)(colon - name) ||
            strncmp(remote->name, name, strlen(remote->name)))
            continue;
        machine = true;
        if (!strcmp(remote->item, colon + 1)) {
            *found = remote;
            return 0;
        }
    }
    *found = NULL;
    return !machine ? -EHOSTUNREACH : colon[1] ? -ENOENT : 0;
}

struct directory *directory_open(struct catalog *catalog) {
    struct directory *directory = calloc(1, sizeof *directory);

    if (directory)
        directory->catalog = catalog;
    return directory;
}

void directory_close(struct directory *directory) {
    while (directory && directory->first) {
        struct remote *remote = directory->first;

        directory->first = remote->next;
        free_remote(remote);
    }
    free(directory);
}
