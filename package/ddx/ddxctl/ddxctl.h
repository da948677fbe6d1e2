/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXCTL_H
#define DDXCTL_H

#include <stdbool.h>

#include "ddx.h"

/* What the command line asked for. */
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
 * Another package's program for the first of these words, of which the array ends with NULL; returns only if that
 * fails: the exit status, or -1: there is none.
 */
int run_word(char **words);
/* The lines of help of all that are installed, onto standard output. */
void print_words(void);

/* One file each; they return the exit status. */
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

/* Bytes as people read them: "152K". */
const char *readable_bytes(uint64_t bytes, char text[16]);

/*
 * Change what "field=value" says in a value of the item's type: `apply` false only checks. NULL, or what is wrong with
 * it, in static memory.
 */
const char *change_field(const DDX_STORE_ITEM *item, void *data, const char *change, bool apply);

/* A frame's fields, one by one: name = value, or the members of a JSON object. */
void print_fields(const DDX_STORE_ITEM *item, const void *data, bool json);

#endif
