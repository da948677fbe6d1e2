/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "handle.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

DDX_COLD int ddx_item_copies(const DDX_STORE_ITEM *item) {
    return *item->type && !item->own ? -EPROTOTYPE : 0; /* an awaited item has no type yet */
}

int ddx_item_set_layout(DDX_STORE_ITEM *item, const struct ddx_layout *layout) {
    if (item->layout && layout->field_count == item->layout->field_count &&
        !memcmp(layout, item->layout, ddx_layout_bytes(layout->field_count)))
        return 0;
    struct ddx_layout *copy = ddx_layout_copy(layout);
    if (!copy)
        return -ENOMEM;
    free(item->layout);
    free(item->fields);
    item->layout = copy;
    item->fields = NULL;
    item->layouts++;
    return 0;
}
