/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "reorder.h"

#include <string.h>

#define BEHIND (UINT32_C(1) << 31) /* numbers wrap: a larger step ahead is a step back */
#define REMEMBERED 32              /* bits of `missed` */

void order_restart(struct order *order) {
    *order = (struct order){.running = false};
}

static bool is_missed(const struct order *order, uint32_t number) {
    uint32_t before = order->last - number - 1;

    return order->running && before < REMEMBERED && order->missed >> before & 1;
}

bool order_add(struct order *order, uint32_t number, unsigned slot, int64_t now) {
    unsigned at = order->count;

    if (is_missed(order, number))
        return false;
    /* Numbers that do not rise (the driver does not count, or starts again) come first, and do not wait. */
    while (at && (int32_t)(number - order->last) < (int32_t)(order->waiting[at - 1].number - order->last))
        at--;
    memmove(&order->waiting[at + 1], &order->waiting[at], (order->count - at) * sizeof order->waiting[0]);
    order->waiting[at].number = number;
    order->waiting[at].slot = slot;
    order->waiting[at].since = now;
    order->count++;
    return true;
}

static bool may_go(const struct order *order, int64_t now, int64_t wait) {
    uint32_t step = order->waiting[0].number - order->last;

    return !order->running || step < 2 || step > ORDER_FAR || order->count == ORDER_WAITING ||
           now - order->waiting[0].since >= wait;
}

/* Marks the numbers between the last frame and this one as missed; at the first frame, those that could still come. */
static void note(struct order *order, uint32_t number) {
    uint32_t step = number - order->last;

    if (!order->running)
        order->missed = (UINT32_C(1) << ORDER_FAR) - 1;
    else if (step >= BEHIND)
        order->missed = 0;
    else if (step >= REMEMBERED)
        order->missed = UINT32_MAX;
    else if (step)
        order->missed = order->missed << step | ((UINT32_C(1) << (step - 1)) - 1);
    order->last = number;
    order->running = true;
}

bool order_next(struct order *order, int64_t now, int64_t wait, unsigned *slot) {
    if (!order->count || !may_go(order, now, wait))
        return false;
    *slot = order->waiting[0].slot;
    note(order, order->waiting[0].number);
    memmove(&order->waiting[0], &order->waiting[1], --order->count * sizeof order->waiting[0]);
    return true;
}

int64_t order_due(const struct order *order, int64_t wait) {
    return order->count ? order->waiting[0].since + wait : INT64_MAX;
}
