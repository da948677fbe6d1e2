/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "machines.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

/* ---- This machine ---- */

static uint64_t hashed(const char *text, uint64_t hash) {
    for (; *text; text++) /* FNV-1a */
        hash = (hash ^ (unsigned char)*text) * UINT64_C(0x100000001b3);
    return hash;
}

/* The id remains the same after a restart of this program, and differs for each network name space of this machine. */
static uint64_t choose_id(const char *boot, long port) {
    struct stat network = {.st_ino = 0};
    char text[64];

    stat("/proc/self/ns/net", &network);
    snprintf(text, sizeof text, " %llu %ld", (unsigned long long)network.st_ino, port);
    return hashed(text, hashed(boot, UINT64_C(0xcbf29ce484222325)));
}

void identity_begin(struct identity *identity, long port) {
    FILE *file = fopen("/proc/sys/kernel/random/boot_id", "re");
    struct timespec now;

    if (!file || fscanf(file, "%39s", identity->boot) != 1)
        strcpy(identity->boot, "0");
    if (file)
        fclose(file);
    identity->id = choose_id(identity->boot, port);
    strcpy(identity->name, identity->host);
    clock_gettime(CLOCK_REALTIME, &now);
    identity->since = now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

/* Whether another machine that is called so had this machine's own name before this machine. */
static bool identity_is_later(const struct identity *identity, const char *called, int64_t since, uint64_t id) {
    if (!name_meets(called, identity->host))
        return false;
    return since != identity->since ? since < identity->since : id < identity->id;
}

void identity_yield(struct identity *identity) {
    name_distinguish(identity->host, identity->id, identity->name);
}

void identity_return(struct identity *identity) {
    strcpy(identity->name, identity->host);
}

/* ---- Clocks ---- */

#define DRIFT_DIVISOR 10000             /* the clocks drift apart by less than 1 ns in 10,000 */
#define LATEST_NS (INT64_C(1) << 61)    /* limit of a clock's time, so that sums cannot overflow */
#define LONGEST_NS INT64_C(10000000000) /* longest duration of an exchange */

static bool is_time(int64_t time) {
    return time >= 0 && time < LATEST_NS;
}

bool offset_add(struct offset *offset, int64_t sent, int64_t received, int64_t answered, int64_t now) {
    if (!is_time(sent) || !is_time(received) || !is_time(answered) || !is_time(now))
        return false;
    int64_t away = now - sent, there = answered - received, trip = away - there;
    if (there < 0 || trip < 0 || away > LONGEST_NS)
        return false;
    offset->sample[offset->count++ % OFFSET_SAMPLES] =
        (struct offset_sample){(received - sent + answered - now) / 2, trip / 2 + there / DRIFT_DIVISOR, now};
    return true;
}

static int64_t bound_of(const struct offset_sample *sample, int64_t now) {
    return sample->bound + (now - sample->at) / DRIFT_DIVISOR;
}

bool offset_get(const struct offset *offset, int64_t now, int64_t *apart, int64_t *bound) {
    const struct offset_sample *best = NULL;

    for (unsigned i = 0; i < OFFSET_SAMPLES && i < offset->count; i++)
        if (!best || bound_of(&offset->sample[i], now) < bound_of(best, now))
            best = &offset->sample[i];
    if (!best)
        return false;
    *apart = best->offset;
    *bound = bound_of(best, now);
    return true;
}

/* ---- The other machines ---- */

struct machine *machines_find(struct machines *machines, uint64_t id) {
    for (unsigned i = 0; i < machines->count; i++)
        if (machines->list[i].id == id)
            return &machines->list[i];
    return NULL;
}

/* Whether one of the first `count` machines has the name already. */
static bool has_name(const struct machines *machines, unsigned count, const char *name) {
    for (unsigned i = 0; i < count; i++)
        if (!machines->list[i].away && !strcmp(machines->list[i].name, name))
            return true;
    return false;
}

/* Machines with equal names choose other names themselves; until then, or if one does not, give them names here. */
void machines_renamed(struct machines *machines, const struct identity *own) {
    for (unsigned i = 0; i < machines->count; i++) {
        struct machine *machine = &machines->list[i];

        if (!strcmp(machine->called, own->name) || has_name(machines, i, machine->called))
            name_distinguish(machine->called, machine->id, machine->name);
        else
            strcpy(machine->name, machine->called);
    }
}

struct machine *machines_take(struct machines *machines, const struct identity *own,
                              const struct network_record *record) {
    struct machine *machine = machines_find(machines, record->machine);

    if (!record->name || !name_is_machine(record->name) || !record->host || !name_is_machine(record->host) ||
        (!machine && machines->count == NETWORK_MACHINES))
        return NULL;
    if (!machine) {
        machine = &machines->list[machines->count++];
        *machine = (struct machine){.id = record->machine};
    }
    machine->away = false;
    strcpy(machine->called, record->name);
    strcpy(machine->host, record->host);
    machine->since = record->since;
    machines_renamed(machines, own);
    return machine;
}

const struct machine *machines_named(const struct machines *machines, const char *name, size_t length) {
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        if (!machine->away && strlen(machine->name) == length && !strncmp(machine->name, name, length))
            return machine;
    }
    return NULL;
}

void machines_away(struct machines *machines, const struct identity *own, uint64_t id) {
    struct machine *machine = machines_find(machines, id);

    if (machine)
        machine->away = true;
    machines_renamed(machines, own);
}

void machines_drop(struct machines *machines, const struct identity *own, uint64_t id) {
    struct machine *machine = machines_find(machines, id), *end = machines->list + machines->count;

    if (!machine)
        return;
    memmove(machine, machine + 1, (size_t)((char *)end - (char *)(machine + 1)));
    machines->count--;
    machines_renamed(machines, own);
}

static bool is_heard(const struct machines *machines, const char *called) {
    for (unsigned i = 0; i < machines->count; i++)
        if (!machines->list[i].away && !strcmp(machines->list[i].called, called))
            return true;
    return false;
}

const struct machine *machines_superseded(const struct machines *machines) {
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        if (machine->away && (machines->count == NETWORK_MACHINES || is_heard(machines, machine->called)))
            return machine;
    }
    return NULL;
}

bool machines_take_name(const struct machines *machines, const struct identity *own, bool proven) {
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        if (!machine->away && (machine->offset.count || !proven) &&
            identity_is_later(own, machine->called, machine->since, machine->id))
            return true;
    }
    return false;
}

unsigned machines_of_host(const struct machines *machines, const struct identity *own) {
    unsigned count = 0;

    for (unsigned i = 0; i < machines->count; i++)
        count += !machines->list[i].away && name_meets(machines->list[i].host, own->host);
    return count;
}
