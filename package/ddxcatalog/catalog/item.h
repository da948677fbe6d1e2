/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Items of the store, for exports, mirrors and accepted topics. */
#ifndef DDXCATALOG_ITEM_H
#define DDXCATALOG_ITEM_H

#include <ddx.h>
#include <form.h>
#include <stdbool.h>

/* Whether the item is unchanged; if not, its form may differ. */
bool item_is_unchanged(const struct ddx_item_info *info, const struct ddx_item_info *before);

/*
 * Get memory for a value of the item, to be published with ddx_store_publish(). It is zeroed, so that equal values have
 * equal bytes, padding included. 0 or -errno, as ddx_store_loan().
 */
int item_loan(DDX_STORE_ITEM *item, const struct form *form, void **data);

#endif
