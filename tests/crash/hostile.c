/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One program is hostile; all others continue: each frame in order, none missed, none torn, new programs are admitted,
 * and the store's own memory stays small.
 */
#include <string.h>

#include "director.h"
#include "tests.h"

#define PERIOD 0.02
#define SECONDS 3.0
#define DESCRIPTORS 1024 /* of the store, so that they can be used up */

/* KiB of the store's memory that is not frames. */
static unsigned long store_memory(void) {
    char path[64], line[128];
    unsigned long found = 0;

    snprintf(path, sizeof path, "/proc/%d/status", (int)store_worker());
    FILE *file = fopen(path, "r");
    while (file && fgets(line, sizeof line, file))
        if (sscanf(line, "RssAnon: %lu", &found) == 1)
            break;
    if (file)
        fclose(file);
    if (!found)
        fail("the store's memory cannot be read; has it ended?");
    return found;
}

static void suffer(char kind, const char *name, unsigned times) {
    struct party *enemy[4], *in_order = &party[2];
    uint64_t missed = actor_of(in_order)->missed;
    unsigned long before = store_memory();

    longest_gap(0);
    for (unsigned i = 0; i < times; i++)
        enemy[i] = party_begin(kind, 0, 0, NULL);
    nap(SECONDS);
    look();
    struct party *newcomer = party_begin('c', 0, 0, NULL);
    AWAIT(actor_of(newcomer)->frames > 3, "%s: newcomers are not let in", name);
    await_frames(0, 30, 1, name);
    if (actor_of(in_order)->missed != missed)
        fail("%s: %llu frames were missed", name, (unsigned long long)(actor_of(in_order)->missed - missed));
    unsigned long after = store_memory();
    printf("%s: %llu attempts, longest gap %.1f ms, the store's own memory %lu to %lu KiB\n", name,
           (unsigned long long)actor_of(enemy[0])->beats, (double)longest_gap(0) / 1e6, before, after);
    if (after > before + 8192)
        fail("%s: the store grows", name);
    for (unsigned i = 0; i < times; i++)
        party_end(enemy[i], SIGKILL);
    party_end(newcomer, SIGTERM);
    await_frames(0, 5, 1, name);
}

int test_hostile(void) {
    store_descriptors = DESCRIPTORS;
    store_begin(NULL);
    party_begin('w', 0, PERIOD, NULL);
    party_begin('n', 0, 0, NULL);
    party_begin('k', 0, 0, NULL);
    await_frames(0, 10, 1, "at first");
    suffer('v', "a vandal", 1);
    suffer('l', "a liar", 1);
    suffer('f', "a flood", 1);
    suffer('f', "two floods", 2);
    return 0;
}
