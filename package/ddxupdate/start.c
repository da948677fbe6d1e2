/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Chooses the slot that does not run for the next start: only if it has a version that names itself. The note on /data
 * comes before the block, in one write each. */
#include <stdio.h>

#include "decide.h"
#include "pace.h"
#include "place.h"
#include "sight.h"
#include "state.h"

static int find_other(const struct request *request, struct release *running, struct release *other) {
    const struct place *place = &request->place;
    const char slot = block_other(place->here);

    if (!release_read(place->release, running))
        return fail(1, "%s: names no board or no version", place->release);
    if (!release_of_slot(request->slots[slot - 'A'], place->mount, other))
        return fail(2, "slot %c has no version; `ddxctl update FILE` writes one", slot);
    return 0;
}

/* What the other version will have to do as well. */
static void look_around(const struct place *place, struct former *former) {
    static struct sight before, now;
    struct rules rules;

    rules_read(&rules, place);
    services_read(place, &now.services);
    sight_look(place, &now);
    before = now;
    if (before.frames.count) {
        pace_sleep(rules.step);
        sight_look(place, &now);
    }
    now.ssh = ssh_answers(rules.ssh);
    former_make(former, &before, &now);
}

static int try_other(const struct request *request, bool older) {
    const struct place *place = &request->place;
    const char slot[] = {block_other(place->here), 0}, here[] = {place->here, 0};
    const struct block block = {.slot = slot[0], .left = '3'};
    struct release running, other;
    int status = find_other(request, &running, &other);

    if (!status)
        status = check_version(place, &running, &other, older);
    if (status)
        return status;
    static struct former former;
    look_around(place, &former);
    const struct state_line lines[] = {{"proven", here},
                                       {"tried", slot},
                                       {"version", other.version},
                                       {"result", "begun"},
                                       {"reason", ""},
                                       {"seen", "no"},
                                       {"runs", former.runs},
                                       {"flows", former.flows},
                                       {"links", former.links},
                                       {"addresses", former.addresses},
                                       {"ssh", former.ssh ? "yes" : "no"},
                                       {"watchdog", former.watchdog ? "yes" : "no"}};
    state_set(place->state, lines, sizeof lines / sizeof lines[0]); /* a full /data must not prevent an update */
    status = choose_write(request, &block);
    if (!status)
        printf("slot %s is started next: version %s\n", slot, other.version);
    return status;
}

int command_start(const struct request *request) {
    struct block block;
    int status = check_machine(&request->place);

    if (!status)
        status = choose_read(request, &block);
    if (!status)
        status = check_no_trial(&request->place, &block);
    return status ? status : try_other(request, request->older);
}

int command_back(const struct request *request) {
    struct block block;
    int status = check_machine(&request->place);

    if (!status)
        status = choose_read(request, &block);
    if (status)
        return status;
    if (!block_is_trial(&block, request->place.here))
        return try_other(request, true);
    status = take_back(request, "a technician has taken it back");
    if (!status)
        printf("slot %c is started next\n", block_other(block.slot));
    return status;
}
