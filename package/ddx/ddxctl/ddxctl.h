/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXCTL_H
#define DDXCTL_H

#include <stdbool.h>

#include "ddx.h"

/* The parsed command line. */
struct request {
    const char *item;
    char **changes; /* set: "field=value" words */
    unsigned change_count;
    bool json;
    int port;
    unsigned count; /* watch: number of frames; 0: until interrupted */
    double every;   /* repeat, seconds between; 0: once */
};

/* The commands; they return the exit status. */
int command_list(DDX_STORE_ID *id, const struct request *request);
int command_show(DDX_STORE_ID *id, const struct request *request);
int command_set(DDX_STORE_ID *id, const struct request *request);
int command_watch(DDX_STORE_ID *id, const struct request *request);
int command_record(DDX_STORE_ID *id, const struct request *request);

/* "ddxctl: item: text" on stderr; returns 1. */
int complain(const char *item, int error);

#endif
