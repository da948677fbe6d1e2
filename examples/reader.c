/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <ddx.h>
#include <stdio.h>

int main(void) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 1.0); /* this machine's store; waits a second for it */
    DDX_STORE_ITEM *item = id ? ddx_store_lookup_item(id, "video", NULL, 0) : NULL;
    struct ddx_frame frame;

    while (item && ddx_store_acquire(item, &frame, 1.0, DDX_NEXT) == 0) { /* no copy; cannot change while held */
        const struct ddx_field *y = ddx_store_field_named(item, "y");     /* where the luminance lies */
        unsigned long long sum = 0;
        for (uint64_t i = 0; y && i < y->used; i++)
            sum += ((const unsigned char *)frame.data)[y->offset + i];
        printf("%llu %lld %llu %llu\n", (unsigned long long)frame.sequence, (long long)frame.time,
               (unsigned long long)frame.missed, sum); /* time: of the write, not of the capture */
        ddx_store_release(item);
    }
    if (!item)
        perror("video"); /* also without a store: ECONNREFUSED */
    ddx_store_close(id);
    return item ? 0 : 1;
}
