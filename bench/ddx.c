/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <stdio.h>

#include "ddx.h"
#include "peer.h"

static DDX_STORE_ID *id;
static DDX_STORE_ITEM *item;
static enum peer_mode mode;
static void *own;

static int failed(const char *what, int error) {
    fprintf(stderr, "ddx: %s: %s\n", what, ddx_error_text(error));
    return 1;
}

int peer_open(const struct peer_setup *setup, bool writer) {
    char declaration[80];

    id = ddx_store_open(NULL, 0, 5.0);
    if (!id)
        return failed("store", -errno);
    mode = setup->mode;
    own = setup->own;
    snprintf(declaration, sizeof declaration, "struct { unsigned char data[%zu]; }", setup->bytes);
    if (writer) {
        struct ddx_item_spec spec = {.name = setup->name, .type = "FRAME", .declaration = declaration};
        int error = ddx_store_create(id, &spec, &item);

        return error ? failed(setup->name, error) : 0;
    }
    item = ddx_store_lookup_item(id, setup->name, "FRAME", (int)setup->bytes); /* the type has a size for each run */
    if (!item)
        return failed(setup->name, -errno);
    if (mode == PEER_DIRECT && !ddx_store_var_pointer(item))
        return failed("window", -errno);
    /* The first read takes a reader's share of memory. */
    struct ddx_frame frame;
    int error = mode == PEER_DIRECT ? ddx_store_read_direct(item, NULL, 0, DDX_NEXT)
                                    : ddx_store_acquire(item, &frame, 0, DDX_NEXT);
    return error == -ETIMEDOUT ? 0 : failed(setup->name, error);
}

void *peer_loan(void) {
    void *data;

    return ddx_store_loan(item, &data) ? NULL : data;
}

int peer_publish(void) {
    return ddx_store_publish(item, NULL);
}

int peer_write(const void *data) {
    return ddx_store_write(item, data, NULL);
}

int peer_receive(void (*deliver)(const void *data)) {
    struct ddx_frame frame;
    int error;

    switch (mode) {
    case PEER_ZEROCOPY:
        if (!(error = ddx_store_acquire(item, &frame, 0.1, DDX_NEXT))) {
            deliver(frame.data);
            ddx_store_release(item);
        }
        break;
    case PEER_COPY:
        if (!(error = ddx_store_read(item, own, NULL, 0.1, DDX_NEXT)))
            deliver(own);
        break;
    default:
        if (!(error = ddx_store_read_direct(item, NULL, 0.1, DDX_NEXT)))
            deliver(ddx_store_var_pointer(item));
    }
    return error && error != -ETIMEDOUT ? failed("receive", error) : 0;
}

void peer_close(void) {
    ddx_store_close(id);
}
