/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Reports to the boot loader that this slot has come up (for its variables see board/common/grub.cfg), unless it is on
 * trial, and writes to /run/slot.failed the slot that should have come up and did not.
 *
 * The loader passes on the kernel's command line how it has counted this boot (ddx.counted). If its block does not have
 * that line, boots are not counted, and the loader would never return to the other slot: /run/slot.wrong reports this
 * for `ddxctl health`.
 */
#include <stdio.h>
#include <string.h>

#include "boot.h"
#include "command.h"
#include "state.h"

enum { TRIAL = 3 }; /* exit status */

#define STAYS ", so a slot that cannot be booted may stay the chosen one; flash another card"

static void note_failed(const struct place *place, const struct block *block, bool lost) {
    char slot[] = {0, 0};

    if (place->here != block->slot && !lost)
        slot[0] = block->slot;
    if (block->failed)
        slot[0] = block->failed;
    if (slot[0])
        place_note(place->failed, slot);
}

/* The running slot is the chosen one, and not on trial. A trial that was kept may have left no note of that. */
static void prove(const struct place *place) {
    const char here[] = {place->here, 0};
    const struct state_line line = {"result", "kept"};

    state_prove(place->state, place->here);
    if (state_is(place->state, "tried", here) && state_is(place->state, "result", "begun"))
        state_set(place->state, &line, 1);
}

/* A block that was lost: the loader has booted slot A, whichever slot was chosen. */
static void restore(const struct place *place, struct block *block) {
    char text[128];

    *block = (struct block){.slot = state_proven(place->state)};
    if (!block->slot)
        block->slot = 'A';
    snprintf(text, sizeof text, "the boot loader's block was lost, and slot A booted; slot %c is the chosen one again",
             block->slot);
    place_note(place->wrong, text);
}

int command_block(const struct request *request) {
    const struct place *place = &request->place;
    char before[BLOCK_SIZE], after[BLOCK_SIZE];
    struct boot boot;
    struct block block;

    if (!place->here)
        return 0; /* started without our boot loader: it has no slots */
    if (boot_open(&boot, request->boot, place->block_lock)) {
        place_note(place->wrong, "the boot loader's block cannot be found" STAYS);
        return 1;
    }
    int error = boot_read(&boot, before);
    if (error) {
        place_note(place->wrong, "the boot partition cannot be read" STAYS);
    } else {
        const bool lost = !block_parse(before, &block);
        if (lost)
            restore(place, &block);
        else if (place->counted[0] && !block_has(&block, place->counted))
            place_note(place->wrong, "the boot loader has not counted this boot" STAYS);
        if (!lost && block_is_trial(&block, place->here)) {
            boot_close(&boot);
            return TRIAL;
        }
        block_came_up(&block, place->here);
        block_format(&block, after);
        if (memcmp(before, after, sizeof after) != 0)
            error = boot_write(&boot, after);
        if (error)
            place_note(place->wrong, "the boot partition cannot be written" STAYS);
        else if (place->here == block.slot)
            prove(place);
        note_failed(place, &block, lost);
    }
    boot_close(&boot);
    return error ? 1 : 0;
}
