/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Change an item: by a request to its program, or by writing its newest value again with some fields changed. */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "ddx_request.h"
#include "ddxctl.h"

static const char *change_all(const DDX_STORE_ITEM *item, void *data, const struct request *request, bool apply) {
    const char *bad = NULL;

    for (unsigned i = 0; i < request->change_count && !bad; i++)
        bad = change_field(item, data, request->changes[i], apply);
    return bad;
}

static int refuse(const struct request *request, const char *bad) {
    fprintf(stderr, "ddxctl: %s: %s\n", request->item, bad);
    return 2;
}

/* Copy, or clear, only the bytes in use: neither frame nor loan has memory beyond a field's extent. */
static void copy(const DDX_STORE_ITEM *item, char *to, const char *from) {
    const struct ddx_field *field;

    for (unsigned i = 0; (field = ddx_store_field(item, i)); i += 1 + field->children) {
        if (from)
            memcpy(to + field->offset, from + field->offset, (size_t)field->used);
        else
            memset(to + field->offset, 0, (size_t)field->used);
    }
}

/*
 * While this handle is the writer, no other program can write between the read of the value and the write of the next
 * one.
 */
static int write_changed(DDX_STORE_ITEM *item, const struct request *request) {
    struct ddx_frame frame;
    void *data;
    int result = ddx_store_loan(item, &data);

    if (result == -EEXIST) {
        struct ddx_item_info info = {.writer_pid = 0};

        ddx_store_item_info(item, &info);
        fprintf(stderr, "ddxctl: %s: not set, process %d writes it; stop it first\n", request->item,
                (int)info.writer_pid);
        return 1;
    }
    if (result)
        return complain(request->item, result);
    result = ddx_store_acquire(item, &frame, 0, DDX_CURRENT);
    if (result && result != -ETIMEDOUT) {
        ddx_store_cancel(item);
        return complain(request->item, result);
    }
    copy(item, data, result ? NULL : frame.data); /* an item that was never written begins with zeros */
    if (!result)
        ddx_store_release(item);
    const char *bad = change_all(item, data, request, true);
    if (bad) { /* a writer has changed the layout since the check */
        ddx_store_cancel(item);
        return refuse(request, bad);
    }
    result = ddx_store_publish(item, NULL);
    return result ? complain(request->item, result) : 0;
}

int command_set(DDX_STORE_ID *id, const struct request *request) {
    int asks = ddx_request_possible(id, request->item);
    if (asks < 0)
        return complain(request->item, asks);
    if (asks)
        return ask_for_changes(id, request);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);

    if (!item)
        return complain(request->item, errno);
    /* All changes are checked before the handle becomes the writer. */
    const char *bad = change_all(item, NULL, request, false);
    int status = bad ? refuse(request, bad) : write_changed(item, request);
    ddx_store_done_item(item);
    return status;
}
