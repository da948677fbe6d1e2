/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "directory.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define TEXT_MAX 16384 /* bytes of a declaration */

struct directory {
    struct catalog *catalog;
    struct remote *first;
    struct machines machines;
    uint64_t changes, refused;
};

static const struct identity *own(const struct directory *directory) {
    return &directory->catalog->identity;
}

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
    return !strncmp(topic, "rt", 2) && name_is_topic(topic + 2);
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

/* Make a remote from a checked record; NULL: the record is invalid, or no memory. */
static struct remote *judged(const struct network_record *record) {
    if (!record->type || !record->declaration || !record->extents || !record->topic || !is_item(record->item) ||
        !is_type(record->type) || !is_topic(record->topic) || strnlen(record->declaration, TEXT_MAX) == TEXT_MAX ||
        strnlen(record->extents, TEXT_MAX) == TEXT_MAX)
        return NULL;
    struct remote *remote = calloc(1, sizeof *remote);
    if (!remote)
        return NULL;
    remote->machine = record->machine;
    remote->since = record->since;
    strcpy(remote->item, record->item);
    remote->topic = strdup(record->topic);
    remote->declaration = strdup(record->declaration);
    remote->extents = strdup(record->extents);
    if (remote->topic && remote->declaration && remote->extents &&
        !form_of_text(record->type, record->declaration, record->extents, &remote->form))
        return remote;
    free_remote(remote);
    return NULL;
}

/* Remove the machine and all its items. */
static void forget(struct directory *directory, uint64_t machine) {
    for (struct remote **at = &directory->first; *at;) {
        struct remote *remote = *at;

        if (remote->machine == machine) {
            *at = remote->next;
            free_remote(remote);
        } else {
            at = &remote->next;
        }
    }
    machines_drop(&directory->machines, own(directory), machine);
}

static void refuse(struct directory *directory) {
    if (!directory->refused++)
        say("an item of another machine is left out: its name or type is invalid, or there are too many items");
}

static void put(struct directory *directory, struct machine *machine, const struct network_record *record) {
    struct remote *remote = judged(record), **at = place_of(directory, record), *old = *at;

    if (!remote || (!old && machine->items == ITEMS_MAX)) {
        refuse(directory);
        free_remote(remote);
        return;
    }
    remote->next = old ? old->next : NULL;
    remote->version = ++directory->changes;
    if (old && old->since == remote->since && !strcmp(old->form->type, remote->form->type) &&
        !strcmp(old->declaration, remote->declaration) && !strcmp(old->extents, remote->extents) &&
        !strcmp(old->topic, remote->topic))
        remote->version = old->version;
    machine->items += !old;
    *at = remote;
    free_remote(old);
}

static void there(struct directory *directory, const struct network_record *record) {
    struct machine *machine = *record->item ? machines_find(&directory->machines, record->machine)
                                            : machines_take(&directory->machines, own(directory), record);

    if (!machine) /* a machine sends its own record before those of its items */
        refuse(directory);
    else if (*record->item)
        put(directory, machine, record);
}

/* A record of an item, or of a machine, was withdrawn; `away`: the machine is silent. */
static void gone(struct directory *directory, const struct network_record *record, bool away) {
    struct remote **at = place_of(directory, record), *remote = *at;
    struct machine *machine = machines_find(&directory->machines, record->machine);

    if (!*record->item && away)
        machines_away(&directory->machines, own(directory), record->machine);
    else if (!*record->item)
        forget(directory, record->machine);
    else if (remote && away)
        remote->away = true;
    else if (remote && machine) {
        *at = remote->next;
        machine->items--;
        free_remote(remote);
    }
}

void directory_take(struct directory *directory, const struct network_record *record, enum network_change change) {
    const struct machine *old;

    bool forged = !record->item || record->machine == own(directory)->id; /* its own are not received */
    if (forged && change == NETWORK_THERE)
        refuse(directory);
    if (forged)
        return;
    if (change == NETWORK_THERE)
        there(directory, record);
    else
        gone(directory, record, change == NETWORK_AWAY);
    while ((old = machines_superseded(&directory->machines)))
        forget(directory, old->id);
}

int directory_find(const struct directory *directory, const char *name, const struct remote **found) {
    const char *colon = strchr(name, ':');

    if (!colon)
        return -EINVAL;
    const struct machine *machine = machines_named(&directory->machines, name, (size_t)(colon - name));
    *found = NULL;
    if (!machine)
        return -EHOSTUNREACH;
    for (const struct remote *remote = directory->first; remote && colon[1]; remote = remote->next)
        if (!remote->away && remote->machine == machine->id && !strcmp(remote->item, colon + 1)) {
            *found = remote;
            return 0;
        }
    return colon[1] ? -ENOENT : 0;
}

void directory_each(struct directory *directory, directory_each_take *take, void *argument) {
    for (const struct remote *remote = directory->first; remote; remote = remote->next)
        take(argument, machines_find(&directory->machines, remote->machine), remote);
}

uint64_t directory_refused(const struct directory *directory) {
    return directory->refused;
}

struct machines *directory_machines(struct directory *directory) {
    return &directory->machines;
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
