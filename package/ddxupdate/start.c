/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * From one version to another, and back. Only a slot with a version that names itself is chosen for the next start. The
 * note on /data comes before the block, in one write each.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "command.h"
#include "decide.h"
#include "pace.h"
#include "place.h"
#include "release.h"
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

/* Note what works now and must work with the other version. */
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

/* In a trial the watchdog begins before the services do. ddxhealth takes it over; until then it is not fed, so a boot
 * that hangs is reset. */
int command_watchdog(const struct request *request) {
    struct rules rules;
    const int watchdog = open(request->boot, O_WRONLY | O_CLOEXEC);

    if (watchdog < 0)
        return fail(1, "%s: %s; a boot that hangs will not be reset", request->boot, strerror(errno));
    rules_read(&rules, &request->place);
    int seconds = (int)rules.watchdog;
    /* Hardware with a fixed or shorter time keeps that. */
    if (ioctl(watchdog, WDIOC_SETTIMEOUT, &seconds))
        fail(0, "%s: its time cannot be set to %d s: %s", request->boot, seconds, strerror(errno));
    ioctl(watchdog, WDIOC_KEEPALIVE, 0);
    close(watchdog); /* without the letter that would stop it */
    return 0;
}
