/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "budget.h"

#include "ddx_time.h"

#define MICROSECOND INT64_C(1000)

/* The time that these bytes take at the rate, rounded up, so that the rate is never exceeded. */
static int64_t time_of_bytes(const struct budget *budget, size_t bytes) {
    return ((int64_t)bytes * 8 * SECOND + budget->rate - 1) / budget->rate;
}

static int64_t bytes_of_time(const struct budget *budget, int64_t ns) {
    return ns / MICROSECOND * budget->rate / (8 * SECOND / MICROSECOND);
}

static void advance_time(struct budget *budget, int64_t now) {
    if (now > budget->now)
        budget->now = now;
    if (budget->spent < budget->now - budget->depth)
        budget->spent = budget->now - budget->depth;
}

void budget_init(struct budget *budget, int64_t rate, int64_t depth, double share, int64_t now) {
    *budget =
        (struct budget){.rate = rate, .depth = depth, .now = now, .spent = now - (int64_t)((double)depth * share)};
}

int64_t budget_tokens(struct budget *budget, int64_t now) {
    advance_time(budget, now);
    return bytes_of_time(budget, budget->now - budget->spent);
}

int64_t budget_size(const struct budget *budget) {
    return bytes_of_time(budget, budget->depth);
}

bool budget_take(struct budget *budget, int64_t now, size_t bytes) {
    advance_time(budget, now);
    int64_t cost = time_of_bytes(budget, bytes);
    if (cost > budget->now - budget->spent)
        return false;
    budget->spent += cost;
    return true;
}

int64_t budget_ready(const struct budget *budget, size_t bytes) {
    int64_t cost = time_of_bytes(budget, bytes);

    return cost > budget->depth ? INT64_MAX : budget->spent + cost;
}
