/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The duration of a takeover and its parts. On a busy machine most of it is waiting for a core, which the store cannot
 * change. So all parties can run with real-time priority, with which other load counts little. Time that a virtual
 * machine's host takes ("steal") is subtracted, since no priority prevents it.
 */
#include "takeover.h"

#include <sched.h>
#include <stdio.h>
#include <unistd.h>

static bool urgent;
static int64_t stolen_before;

bool takeover_urgent(void) {
    struct sched_param parameters = {.sched_priority = 1};

    urgent = !sched_setscheduler(0, SCHED_RR, &parameters); /* parties and store inherit it */
    return urgent;
}

/* ns that the host has taken from all processors, as far as the kernel knows; 0 on a physical machine. */
static int64_t stolen(void) {
    unsigned long long ticks = 0;
    FILE *file = fopen("/proc/stat", "re");

    if (file && fscanf(file, "cpu %*u %*u %*u %*u %*u %*u %*u %llu", &ticks) != 1)
        ticks = 0;
    if (file)
        fclose(file);
    return (int64_t)(ticks * (1000000000ull / (unsigned long long)sysconf(_SC_CLK_TCK)));
}

void takeover_begin(void) {
    stolen_before = stolen();
}

static int64_t at(enum ddx_point point) {
    return atomic_load(&stage->journal.at[point]);
}

struct takeover takeover_done(unsigned stream, uint32_t term, int64_t since, const struct party *first_reader) {
    int64_t published = stage->stream[stream].term[term].time, seen = actor_of(first_reader)->term_time;

    return (struct takeover){.whole = seen - since,
                             .noticed = at(DDX_AT_STORE_WRITER_LEFT) - since,
                             .granted = at(DDX_AT_STORE_GRANTED) - at(DDX_AT_STORE_WRITER_LEFT),
                             .published = published - at(DDX_AT_STORE_GRANTED),
                             .seen = seen - published};
}

const char *takeover_text(const struct takeover *t) {
    static char text[128];

    snprintf(text, sizeof text, "%.1f ms: noticed %.1f, granted %.1f, published %.1f, seen %.1f",
             (double)t->whole / 1e6, (double)t->noticed / 1e6, (double)t->granted / 1e6, (double)t->published / 1e6,
             (double)t->seen / 1e6);
    return text;
}

void takeover_check(const struct takeover *t, const char *when) {
    int64_t host = stolen() - stolen_before;

    if (t->whole - host > TAKEOVER || (urgent && t->whole - t->seen - host > TAKEOVER_URGENT))
        fail("%s: takeover in %s; %.0f ms of them the host's", when, takeover_text(t), (double)host / 1e6);
}
