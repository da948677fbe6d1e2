/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A direct read finds each newer frame overtaken: the window still shows the previous one, and no program writes there.
 */
#include <errno.h>

#include "../../package/ddx/lib/handle.h"
#include "store_process.h"

#define FRAMES 30 /* enough to go through all slots */

DDX_STORE_TYPE(
    BLOCK, struct {
        int number;
        char bytes[100000];
    });

static BLOCK value;

static void write_next(DDX_STORE_ITEM *out) {
    value.number++;
    memset(value.bytes, value.number, sizeof value.bytes);
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
}

/* Acts as if the writer were in this slot again at each look of the reader. */
static void overtake(DDX_STORE_ITEM *out, unsigned slot, uint32_t *former) {
    ddx_word *generation = &out->writer.term->control->slot[slot].generation;

    *former = atomic_exchange(generation, DDX_WRITING);
}

int main(void) {
    uint32_t former, shown, latest;

    store_folder_make();
    store_start("8M");
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 10);
    DDX_STORE_ITEM *out = ddx_store_lookup_item(id, "window", "BLOCK", sizeof(BLOCK));
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "window", "BLOCK", sizeof(BLOCK));
    CHECK(out && in);
    const BLOCK *live = ddx_store_var_pointer(in);
    write_next(out);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_CURRENT), 0);
    write_next(out);
    unsigned newest = ddx_ring_newest(out->writer.term->control, &latest);
    overtake(out, newest, &former);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0.01, DDX_NEXT), -ETIMEDOUT);
    atomic_store(&out->writer.term->control->slot[newest].generation, former);
    for (int i = 0; i < FRAMES; i++)
        write_next(out);
    CHECK_EQUAL(live->number, 1);
    CHECK_EQUAL(live->bytes[sizeof live->bytes - 1], 1);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_NEXT), 0);
    CHECK_EQUAL(live->number, FRAMES + 2);

    /* The shown frame is overwritten as well: the read ends nevertheless. */
    unsigned old = (unsigned)in->reader.shown;
    write_next(out);
    newest = ddx_ring_newest(out->writer.term->control, &latest);
    overtake(out, newest, &former);
    overtake(out, old, &shown);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    atomic_store(&out->writer.term->control->slot[old].generation, shown);
    atomic_store(&out->writer.term->control->slot[newest].generation, former);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_NEXT), 0);
    CHECK_EQUAL(live->number, FRAMES + 3);
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
