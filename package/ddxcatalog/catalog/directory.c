/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "directory.h"

#include <ctype.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define FORM_MAX (8u << 20)          /* bytes of an item's form, which is made when the item is wanted */
#define MACHINE_MAX (1u << 20)       /* bytes of the records of a machine, */
#define ALL_MAX (8u << 20)           /* and of all machines */
#define TELL_NS INT64_C(60000000000) /* between two lines on refused records */

struct directory {
    struct catalog *catalog;
    struct remote *first;
    struct machines machines;
    uint64_t changes, refused;
    size_t bytes;     /* of all records */
    int64_t reported; /* time of the last line on refused records; 0: none yet */
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
    free(remote);
}

static struct remote **place_of(struct directory *directory, const struct network_record *record) {
    struct remote **at = &directory->first;

    while (*at && ((*at)->machine != record->machine || strcmp((*at)->item, record->item)))
        at = &(*at)->next;
    return at;
}

static bool is_short(const char *text) {
    return strnlen(text, NETWORK_TEXT) < NETWORK_TEXT;
}

/* Whether the record is valid; *message_size is then set. */
static bool is_valid(const struct network_record *record, size_t *message_size) {
    struct form_measures form;

    if (!record->type || !record->declaration || !record->extents || !record->topic || !is_item(record->item) ||
        !is_type(record->type) || !is_topic(record->topic) || !is_short(record->declaration) ||
        !is_short(record->extents) || form_measure(record->declaration, record->extents, &form) ||
        form.bytes > FORM_MAX)
        return false;
    *message_size = form.message_size;
    return true;
}

/* Make a remote from a valid record; NULL: no memory. */
static struct remote *make(const struct network_record *record, size_t message_size) {
    struct remote *remote = calloc(1, sizeof *remote);

    if (!remote)
        return NULL;
    remote->machine = record->machine;
    remote->since = record->since;
    remote->message_size = message_size;
    strcpy(remote->item, record->item);
    strcpy(remote->type, record->type);
    remote->topic = strdup(record->topic);
    remote->declaration = strdup(record->declaration);
    remote->extents = strdup(record->extents);
    if (!remote->topic || !remote->declaration || !remote->extents) {
        free_remote(remote);
        return NULL;
    }
    remote->bytes = sizeof *remote + strlen(remote->topic) + strlen(remote->declaration) + strlen(remote->extents) + 3;
    return remote;
}

/* Whether the record says the same as this one. */
static bool is_same_record(const struct network_record *record, const struct remote *old) {
    return record->type && record->declaration && record->extents && record->topic && old->since == record->since &&
           !strcmp(old->type, record->type) && !strcmp(old->declaration, record->declaration) &&
           !strcmp(old->extents, record->extents) && !strcmp(old->topic, record->topic);
}

/* Remove the machine and all its items. */
static void forget(struct directory *directory, uint64_t machine) {
    for (struct remote **at = &directory->first; *at;) {
        struct remote *remote = *at;

        if (remote->machine == machine) {
            *at = remote->next;
            directory->bytes -= remote->bytes;
            free_remote(remote);
        } else {
            at = &remote->next;
        }
    }
    machines_drop(&directory->machines, own(directory), machine);
}

/* Copy a name from the network for a line of the log. */
static void show(const char *name, char shown[DDX_NAME_MAX + 1]) {
    unsigned length = 0;

    for (; name && name[length] && length < DDX_NAME_MAX; length++)
        shown[length] = name[length] > ' ' && name[length] <= '~' ? name[length] : '?';
    shown[length] = 0;
}

void directory_refuse(struct directory *directory, uint64_t count, uint64_t machine, const char *item) {
    const struct machine *known = machines_find(&directory->machines, machine);
    char shown[DDX_NAME_MAX + 1];
    int64_t now = ddx_time_now();

    directory->refused += count;
    if (!count || (directory->reported && now - directory->reported < TELL_NS))
        return;
    directory->reported = now;
    if (!machine) {
        say("announcements of other machines are left out: there are too many, or they are too large; %llu until now",
            (unsigned long long)directory->refused);
        return;
    }
    show(item, shown);
    say("machine %s (%llx): its record of %.63s is left out: it is invalid, or there are too many, or they are too "
        "large; %llu until now",
        known ? known->called : "?", (unsigned long long)machine, *shown ? shown : "itself",
        (unsigned long long)directory->refused);
}

static void refuse(struct directory *directory, const struct network_record *record) {
    directory_refuse(directory, 1, record->machine, record->item);
}

static bool has_room(const struct directory *directory, const struct machine *machine, const struct remote *remote,
                     const struct remote *old) {
    size_t before = old ? old->bytes : 0;

    return (old || machine->items < ITEMS_MAX) && machine->bytes - before + remote->bytes <= MACHINE_MAX &&
           directory->bytes - before + remote->bytes <= ALL_MAX;
}

static void put(struct directory *directory, struct machine *machine, const struct network_record *record) {
    struct remote **at = place_of(directory, record), *old = *at;
    size_t message_size;

    if (old && is_same_record(record, old)) {
        old->away = false;
        return;
    }
    struct remote *remote = is_valid(record, &message_size) ? make(record, message_size) : NULL;
    if (!remote || !has_room(directory, machine, remote, old)) {
        refuse(directory, record);
        free_remote(remote);
        return;
    }
    remote->next = old ? old->next : NULL;
    remote->version = ++directory->changes;
    machine->items += !old;
    machine->bytes += remote->bytes - (old ? old->bytes : 0);
    directory->bytes += remote->bytes - (old ? old->bytes : 0);
    *at = remote;
    free_remote(old);
}

static void there(struct directory *directory, const struct network_record *record) {
    struct machine *machine = *record->item ? machines_find(&directory->machines, record->machine)
                                            : machines_take(&directory->machines, own(directory), record);

    if (!machine) /* a machine sends its own record before those of its items */
        refuse(directory, record);
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
        machine->bytes -= remote->bytes;
        directory->bytes -= remote->bytes;
        free_remote(remote);
    }
}

void directory_take(struct directory *directory, const struct network_record *record, enum network_change change) {
    const struct machine *old;

    bool forged = !record->item || record->machine == own(directory)->id; /* its own are not received */
    if (forged && change == NETWORK_THERE)
        refuse(directory, record);
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
