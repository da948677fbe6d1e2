/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "item.h"

#include <string.h>

bool item_is_unchanged(const struct ddx_item_info *info, const struct ddx_item_info *before) {
    return info->epoch == before->epoch && info->size == before->size && !strcmp(info->type, before->type);
}

int item_loan(DDX_STORE_ITEM *item, const struct form *form, void **data) {
    int error = ddx_store_loan(item, data);

    if (!error)
        memset(*data, 0, form->item_size);
    return error;
}
