/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Requests; the public calls are in request.c. This layer is below remote.c, which sends requests to the catalog, so
 * the caller passes the function that finds items.
 */
#ifndef DDX_EXCHANGE_H
#define DDX_EXCHANGE_H

#include "ddx_request.h"

/* As ddx_store_lookup_item(). */
typedef DDX_STORE_ITEM *ddx_lookup(DDX_STORE_ID *id, const char *name, const char *type, int size);

/* "<item>.request", "<item>.answer"; false if that is too long. */
int ddx_request_name(char name[DDX_NAME_MAX + 1], const char *item, const char *suffix);

/* Terminate another program's text and replace control characters, since it goes to logs and terminals. */
void ddx_request_clean(char *text, size_t bytes);

/* Open the two request items of a living program. 0; -EOPNOTSUPP, else as `lookup`. */
int ddx_request_find(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, DDX_STORE_ITEM **to,
                     DDX_STORE_ITEM **from);

/* As ddx_request(). */
int ddx_request_by(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, const struct ddx_change *changes,
                   unsigned count, double timeout, char text[DDX_ANSWER_TEXT]);

#endif
