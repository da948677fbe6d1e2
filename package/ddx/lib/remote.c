/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Items of other machines: the catalog makes them in this machine's store, on request. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "exchange.h"
#include "futex.h"
#include "item.h"
#include "type.h"

#define CATALOG "catalog"
#define OPEN_STEP 20000000 /* ns between two attempts to find a machine */
#define ASK 5.0            /* s that the catalog may take to answer */

/* As ddx_store_lookup_item(), for items of this machine. */
static DDX_STORE_ITEM *find_here(DDX_STORE_ID *id, const char *name, const char *type, int size) {
    DDX_STORE_ITEM *item = NULL;
    int error = ddx_local_lookup(id, name, type, size, &item);

    if (!error)
        return item;
    errno = -error;
    return NULL;
}

/* Ask the catalog for "carol:gps", or with "carol:" whether it has heard from that machine. 0 or -errno. */
static int ask(const DDX_STORE_ID *id, const char *name, double timeout) {
    char pieces[DDX_NAME_MAX / (DDX_REQUEST_NAME - 1) + 1][DDX_REQUEST_NAME], text[DDX_ANSWER_TEXT];
    struct ddx_change changes[sizeof pieces / sizeof *pieces];
    DDX_STORE_ID here = {.port = id->port}; /* requests do not cross machines */
    unsigned count = 0;

    for (size_t at = 0; at < strlen(name); at += DDX_REQUEST_NAME - 1) {
        snprintf(pieces[count], DDX_REQUEST_NAME, "%s", name + at);
        changes[count] = (struct ddx_change){pieces[count], 1};
        count++;
    }
    return ddx_request_by(find_here, &here, CATALOG, changes, count, timeout, text);
}

static int wait_for_machine(const DDX_STORE_ID *id, const char *host, int64_t deadline) {
    char name[DDX_NAME_MAX + 1];
    int error;

    if (snprintf(name, sizeof name, "%s:", host) >= DDX_NAME_MAX || !ddx_item_name_ok(name) ||
        strchr(host, ':'))
        return -EINVAL;
    /* The catalog may be started after this program. */
    while (((error = ask(id, name, ASK)) == -EHOSTUNREACH || error == -EOPNOTSUPP) && ddx_time_now() < deadline)
        nanosleep(&(struct timespec){.tv_nsec = OPEN_STEP}, NULL);
    return error;
}

DDX_STORE_ID *ddx_store_open(const char *host, int port, double timeout) {
    int64_t deadline = timeout < 0 || timeout > 1e9 ? DDX_FOREVER : ddx_time_now() + (int64_t)(timeout * 1e9);
    DDX_STORE_ID *id = NULL;
    int error = port < 0 || port > 65535 ? -EINVAL : ddx_local_open(port, deadline, &id);

    if (!error && host && strcmp(host, "localhost") != 0) {
        error = wait_for_machine(id, host, deadline);
        if (!error)
            strcpy(id->host, host);
    }
    if (!error)
        return id;
    ddx_store_close(id);
    errno = -error;
    return NULL;
}

/* The name in this store of the item that the program calls `name`. */
static int full_name(const DDX_STORE_ID *id, const char *name, char full[DDX_NAME_MAX + 1]) {
    int length = snprintf(full, DDX_NAME_MAX + 1, "%s%s%s", id->host, *id->host ? ":" : "", name);

    return length > DDX_NAME_MAX ? -EINVAL : 0;
}

DDX_STORE_ITEM *ddx_store_lookup_item(DDX_STORE_ID *id, const char *name, const char *type, int size) {
    char full[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *item = NULL;
    int error = !id || !name ? -EINVAL : full_name(id, name, full);
    int asked = !error && strchr(full, ':') ? ask(id, full, ASK) : 0;

    /* Only the catalog makes items of other machines. Their last value can be read while the machine is away. */
    if (!error && *id->host)
        error = ddx_local_lookup(id, full, NULL, 0, &item);
    else if (!error)
        error = ddx_local_lookup(id, full, type, size, &item);
    if (error == -ENOENT && asked && asked != -EOPNOTSUPP)
        error = asked;
    if (!error)
        return item;
    errno = -error;
    return NULL;
}
