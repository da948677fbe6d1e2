/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "checks.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "place.h"

int check_machine(const struct place *place) {
    char reason[256];

    if (!place->here)
        return fail(2, "this machine was not started by the appliance's boot loader");
    if (!place->layout[0])
        return fail(2, "the boot menu of this card is too old for updates; flash the card once more");
    if (place_line(place->wrong, reason, sizeof reason))
        return fail(2, "%s", reason);
    const int lock = open(place->lock, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (lock < 0)
        return fail(errno == EACCES ? 2 : 1, "%s: %s", place->lock, strerror(errno));
    if (flock(lock, LOCK_EX | LOCK_NB))
        return fail(2, "another update is at work");
    return 0; /* `lock` stays open */
}

int check_no_trial(const struct place *place, const struct block *block) {
    if (block_is_trial(block, place->here))
        return fail(2, "this version is on trial; wait for its end, or decide: ddxctl update keep, or back");
    return 0;
}

int check_version(const struct place *place, const struct release *running, const struct release *other, bool older) {
    if (strcmp(running->board, other->board) != 0)
        return fail(2, "version %s is for the board %s, this is a %s", other->version, other->board, running->board);
    if (other->layout != strtoull(place->layout, NULL, 10))
        return fail(2, "version %s is for a disk with layout %" PRIu64 ", this one has %s; flash the card instead",
                    other->version, other->layout, place->layout);
    if (other->serial < running->oldest)
        return fail(2,
                    "version %s (serial %" PRIu64 ") is too old for this one, which goes back to %" PRIu64 " at most",
                    other->version, other->serial, running->oldest);
    if (other->serial < running->serial && !older)
        return fail(2, "version %s (serial %" PRIu64 ") is older than this one (%" PRIu64 "); -older allows that",
                    other->version, other->serial, running->serial);
    return 0;
}
