/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes an update into the slot that does not run. The order of writes leaves, at any power cut, a chosen slot that is
 * whole: first the running slot becomes the chosen one; then the other one loses its begin, so that the boot loader
 * finds no kernel there; its begin is written last, and only `start` chooses it.
 */
#include <inttypes.h>
#include <sodium.h>
#include <stdio.h>
#include <unistd.h>

#include "checks.h"
#include "choose.h"
#include "package.h"
#include "place.h"
#include "slot.h"
#include "state.h"

/* The running slot becomes the chosen one, also if the block is lost later. */
static int stay_here(const struct request *request, struct block *block) {
    const struct place *place = &request->place;

    state_prove(place->state, place->here);
    if (block->slot == place->here)
        return 0;
    block->slot = place->here;
    block->left = 0;
    block->begun = 0;
    return choose_write(request, block);
}

static int write_pieces(struct slot *slot, const struct manifest *manifest) {
    if (slot_clear(slot))
        return 1;
    for (unsigned i = 0; i < manifest->count; i++) {
        uint8_t *bytes = i ? slot->piece : slot->first;
        if (package_piece(STDIN_FILENO, manifest, i, bytes))
            return 1;
        if (!slot_fits(manifest, i, bytes))
            return fail(1, "MiB %u of the update file is not the one that was signed", i);
        if (i && slot_put(slot, manifest, i))
            return 1;
    }
    if (package_end(STDIN_FILENO, manifest) || slot_finish(slot, manifest))
        return 1;
    if (!slot_compare(slot, manifest))
        return 0;
    slot_clear(slot);
    return 1;
}

static int write_slot(const struct request *request, struct block *block, const struct manifest *manifest, char other) {
    struct pace pace = {0};
    struct slot slot;

    if (slot_open(&slot, request->slots[other - 'A']))
        return 1;
    slot.pace = &pace;
    int status = manifest->size > slot.size ? fail(2, "version %s is too large for slot %c", manifest->version, other)
                                            : stay_here(request, block);
    if (!status)
        status = write_pieces(&slot, manifest);
    slot_close(&slot);
    return status;
}

int command_write(const struct request *request) {
    static struct manifest manifest;
    const struct place *place = &request->place;
    struct update_key keys[KEYS_MAX];
    struct release running;
    struct block block;
    int status = check_machine(place);

    if (status)
        return status;
    if (sodium_init() < 0)
        return fail(1, "no cryptography");
    if (!release_read(place->release, &running))
        return fail(1, "%s: names no board or no version", place->release);
    const unsigned count = keys_read(place->keys, keys);
    if (!count)
        return fail(2, "this image has no key that an update could be signed with; flash the card instead");
    status = choose_read(request, &block);
    if (!status)
        status = check_no_trial(place, &block);
    if (!status)
        status = package_begin(STDIN_FILENO, keys, count, &manifest);
    if (status)
        return status;
    struct release new = {.layout = manifest.layout, .serial = manifest.serial};
    snprintf(new.board, sizeof new.board, "%s", manifest.board);
    snprintf(new.version, sizeof new.version, "%s", manifest.version);
    status = check_version(place, &running, &new, request->older);
    const char other = block_other(place->here);
    if (!status)
        status = write_slot(request, &block, &manifest, other);
    if (!status)
        printf("slot %c: version %s; `ddxctl update start` restarts into it\n", other, manifest.version);
    return status;
}
