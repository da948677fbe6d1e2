/* SPDX-License-Identifier: GPL-2.0-or-later */
/* "brightness=128" for an item whose program takes requests. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_request.h"
#include "ddxctl.h"

#define ANSWER_WAIT 3.0 /* s */

static bool parse(const char *word, char name[DDX_REQUEST_NAME], struct ddx_change *change) {
    const char *equals = strchr(word, '=');
    char *end;

    if (!equals || (size_t)(equals - word) >= DDX_REQUEST_NAME)
        return false;
    snprintf(name, DDX_REQUEST_NAME, "%.*s", (int)(equals - word), word);
    const char *digits = equals + 1 + (equals[1] == '-' || equals[1] == '+');
    bool hexadecimal = *digits == '0' && (digits[1] | 32) == 'x'; /* no octal: 010 is ten */
    errno = 0;
    change->name = name;
    change->value = strtoll(equals + 1, &end, hexadecimal ? 16 : 10);
    return !errno && *digits >= '0' && *digits <= '9' && !*end;
}

int ask_for_changes(DDX_STORE_ID *id, const struct request *request) {
    char names[DDX_REQUEST_CHANGES][DDX_REQUEST_NAME], text[DDX_ANSWER_TEXT];
    struct ddx_change changes[DDX_REQUEST_CHANGES];

    for (unsigned i = 0; i < request->change_count && i < DDX_REQUEST_CHANGES; i++)
        if (!parse(request->changes[i], names[i], &changes[i])) {
            fprintf(stderr, "ddxctl: %s: %s: not name=number\n", request->item, request->changes[i]);
            return 2;
        }
    int error = ddx_request(id, request->item, changes, request->change_count, ANSWER_WAIT, text);
    if (error)
        fprintf(stderr, "ddxctl: %s: %s\n", request->item, text);
    if (!error)
        return 0;
    return error == -EINVAL || error == -ERANGE || error == -EACCES ? 2 : 1;
}
