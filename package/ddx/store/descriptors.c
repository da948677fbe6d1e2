/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <fcntl.h>
#include <limits.h>
#include <unistd.h>

#include "descriptors.h"
#include "leftover.h"

#define WANTED_MAX (DDX_SLOTS_MAX + 8u) /* an item's frames and its other files */
#define NEEDED "descriptors are"

/* Number of free descriptors, up to `wanted`. */
static unsigned count_free(unsigned wanted) {
    int fd[WANTED_MAX];
    unsigned count = 0;

    while (count < wanted && (fd[count] = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 0)) >= 0)
        count++;
    for (unsigned i = 0; i < count; i++)
        close(fd[i]);
    return count;
}

bool descriptors_for_item(struct item *item, unsigned count) {
    const struct store *store = item->store;
    unsigned wanted = count < WANTED_MAX ? count : WANTED_MAX, found;
    struct item *victim;

    while ((found = count_free(wanted)) < wanted && found + leftover_files(store, item) >= wanted &&
           (victim = leftover_first(store, item, INT_MAX, NULL)))
        leftover_drop(victim, NEEDED, item->name);
    return found >= wanted;
}

bool descriptors_below(struct store *store, int number) {
    struct item *victim = leftover_first(store, NULL, number, NULL);

    if (victim)
        leftover_drop(victim, NEEDED, "a connection");
    return victim != NULL;
}
