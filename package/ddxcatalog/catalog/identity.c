/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "identity.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

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

bool identity_is_later(const struct identity *identity, const char *called, int64_t since, uint64_t id) {
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
