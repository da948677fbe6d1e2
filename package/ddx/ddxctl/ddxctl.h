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

/*
 * Execute another package's program for the first of these words (the array ends with NULL). Returns only on failure:
 * the exit status, or -1 if there is no such program.
 */
int run_word(char **words);
/* Print the help of all installed words to standard output. */
void print_words(void);

/* The commands, one file each; they return the exit status. */
int command_list(DDX_STORE_ID *id, const struct request *request);
int command_show(DDX_STORE_ID *id, const struct request *request);
int command_set(DDX_STORE_ID *id, const struct request *request);
int command_watch(DDX_STORE_ID *id, const struct request *request);
int command_record(DDX_STORE_ID *id, const struct request *request);
int command_stats(DDX_STORE_ID *id, const struct request *request);

/* Ask the program that writes the item for the changes (ddx_request.h); the exit status. */
int ask_for_changes(DDX_STORE_ID *id, const struct request *request);

/* "ddxctl: item: text" on stderr; returns 1. */
int complain(const char *item, int error);

/* Print `text` as a JSON string, with its quotes; `length` bytes or up to a NUL. */
void json_string(const char *text, size_t length);

/* A readable number of bytes: "152K". */
const char *readable_bytes(uint64_t bytes, char text[16]);

/*
 * Apply "field=value" to a value of the item's type; `apply` false: only check it. NULL, or the error text, in static
 * memory.
 */
const char *change_field(const DDX_STORE_ITEM *item, void *data, const char *change, bool apply);

/* Print a frame's fields: one name and value a line, or the members of a JSON object. */
void print_fields(const DDX_STORE_ITEM *item, const void *data, bool json);

#endif
