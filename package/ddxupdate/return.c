/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The end of a trial that has failed, and of one whose version a technician does not want. */
#include <stdio.h>
#include <string.h>

#include "decide.h"
#include "place.h"
#include "release.h"
#include "state.h"

/* Whether a restart leads to another version: the other slot has one, and this program or the boot loader, which then
 * has to count, can choose it. Without that the machine would restart for ever. */
int command_return(const struct request *request) {
    const struct place *place = &request->place;
    const char other = block_other(place->here);
    struct release release;
    struct block block;

    if (!place->here || choose_read(request, &block))
        return fail(1, "the boot loader's block cannot be read, so this version stays");
    if (!block_is_trial(&block, place->here))
        return fail(1, "no version is on trial");
    if (!release_of_slot(request->slots[other - 'A'], place->mount, &release))
        return fail(1, "slot %c has no version to go back to, so this one stays", other);
    if (!take_back(request, request->reason))
        return 0;
    return place->counted[0] && block_has(&block, place->counted) ? 0 : 1;
}

int command_ended(const struct request *request) {
    const struct place *place = &request->place;
    char tried[2 + 1], reason[256];
    struct block block;

    state_get(place->state, "tried", tried, sizeof tried);
    if (!place->here || !tried[0] || tried[0] == place->here || !state_is(place->state, "result", "begun"))
        return 1;
    if (choose_read(request, &block) || (block.slot == tried[0] && !block.left))
        return 1; /* it was kept, and only this boot is one of the other slot */
    if (block.slot != tried[0] && block.failed != tried[0]) {
        /* The power was cut before `start` could choose the slot, or the block was lost since. */
        const struct state_line line = {"tried", ""};
        state_set(place->state, &line, 1);
        return 1;
    }
    state_get(place->state, "reason", reason, sizeof reason);
    if (!reason[0] && block.slot == tried[0])
        snprintf(reason, sizeof reason, "the boot loader could not start slot %c", tried[0]);
    else if (!reason[0])
        snprintf(reason, sizeof reason, "it was started three times, and each time it stopped or hung");
    snprintf(reason + strlen(reason), sizeof reason - strlen(reason), "%s", request->reason);
    const struct state_line lines[] = {{"result", "returned"}, {"reason", reason}, {"seen", "no"}};
    return state_set(place->state, lines, sizeof lines / sizeof lines[0]) ? 1 : 0;
}

int command_seen(const struct request *request) {
    const struct place *place = &request->place;
    const struct state_line line = {"seen", "yes"};
    struct block block;
    int status = check_machine(place);

    if (!status)
        status = choose_read(request, &block);
    if (!status && block.failed) {
        block.failed = 0;
        status = choose_write(request, &block);
    }
    if (!status)
        status = state_set(place->state, &line, 1) ? 1 : 0;
    if (!status && block.slot == place->here)
        remove(place->failed);
    return status;
}
