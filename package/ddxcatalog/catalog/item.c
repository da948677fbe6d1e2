/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "item.h"

#include <string.h>

#define PADDING 8 /* bytes, between two fields: more than that is the unused part of a field with an extent */

bool item_is_unchanged(const struct ddx_item_info *info, const struct ddx_item_info *before) {
    return info->epoch == before->epoch && info->size == before->size && !strcmp(info->type, before->type);
}

/* Not the unused part of a field: the store has no memory for it. */
static void clear_padding(const struct form *form, unsigned char *data) {
    uint64_t end = 0;

    for (unsigned i = 0; i < form->leaf_count; i++) {
        const struct form_leaf *leaf = &form->leaves[i];

        if (leaf->item - end < PADDING)
            memset(data + end, 0, leaf->item - end);
        end = leaf->item + (uint64_t)leaf->bytes * leaf->count;
    }
    if (form->item_size - end < PADDING)
        memset(data + end, 0, form->item_size - end);
}

int item_loan(DDX_STORE_ITEM *item, const struct form *form, void **data) {
    int error = ddx_store_loan(item, data);

    if (!error)
        clear_padding(form, *data);
    return error;
}
