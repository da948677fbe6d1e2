/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "decide.h"

#include "checks.h"
#include "choose.h"
#include "place.h"
#include "state.h"

/* The block comes first: without it, `kept` would be a lie. After a power cut in between, the next boot adds the rest
 * (came_up.c). */
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

/* The reason comes first: it cannot be found out later. The result is noted by the other version (ended.c). */
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
