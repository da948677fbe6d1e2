/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decide.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "boot.h"
#include "state.h"

int choose_read(const struct request *request, struct block *block) {
    struct boot boot;
    char text[BLOCK_SIZE];

    if (boot_open(&boot, request->boot, request->place.block_lock))
        return 1;
    const int error = boot_read(&boot, text);
    boot_close(&boot);
    if (!error && !block_parse(text, block))
        *block = (struct block){.slot = 'A'};
    return error ? 1 : 0;
}

int choose_write(const struct request *request, const struct block *block) {
    struct boot boot;
    char text[BLOCK_SIZE];

    if (boot_open(&boot, request->boot, request->place.block_lock))
        return 1;
    block_format(block, text);
    const int error = boot_write(&boot, text);
    boot_close(&boot);
    return error ? 1 : 0;
}

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

static double number(const struct place *place, const char *name, double usual) {
    char text[WORD_MAX], *end;

    state_get(place->rules, name, text, sizeof text);
    const double value = strtod(text, &end);
    return *text && !*end && value > 0 && value < 1e6 ? value : usual;
}

void rules_read(struct rules *rules, const struct place *place) {
    *rules = (struct rules){.good = number(place, "good", 300),
                            .deadline = number(place, "deadline", 900),
                            .silence = number(place, "silence", 10),
                            .step = number(place, "step", 5),
                            .watchdog = (unsigned)number(place, "watchdog", 300),
                            .ssh = (unsigned)number(place, "ssh", 22)};
}

/* The block comes first: without it, `kept` would be a lie. After a power cut in between, the next boot adds the rest
 * (boot.c). */
int keep(const struct request *request) {
    const struct place *place = &request->place;
    const char here[] = {place->here, 0};
    const struct block block = {.slot = place->here};
    const struct state_line lines[] = {{"proven", here}, {"result", "kept"}};
    const int status = choose_write(request, &block);

    if (!status)
        state_set(place->state, lines, sizeof lines / sizeof lines[0]);
    return status;
}

/* The reason comes first: it cannot be found out later. The result is noted by the other version (start.c). */
int take_back(const struct request *request, const char *reason) {
    const struct place *place = &request->place;
    const struct block block = {.slot = block_other(place->here), .failed = place->here};
    const struct state_line line = {"reason", reason};

    state_set(place->state, &line, 1);
    return choose_write(request, &block);
}

static int check_trial(const struct request *request) {
    struct block block;
    int status = check_machine(&request->place);

    if (!status)
        status = choose_read(request, &block);
    if (!status && !block_is_trial(&block, request->place.here))
        status = fail(2, "no version is on trial");
    return status;
}

int command_keep(const struct request *request) {
    const int status = check_trial(request);

    return status ? status : keep(request);
}
