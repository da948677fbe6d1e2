/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Print the versions in both slots, the slot that is started next, and the result of the last attempt. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "decide.h"
#include "place.h"
#include "release.h"
#include "state.h"

struct answer {
    struct release slots[2];
    bool found[2];
    struct block block;
    char tried[WORD_MAX], result[WORD_MAX], reason[256], progress[256];
};

/* How the slot of the last `start` or `back` fared. A trial may be over without a note, see boot.c and start.c. */
static const char *result(const struct request *request, const struct answer *answer) {
    const char tried = answer->tried[0];

    if (answer->block.left && answer->block.slot == request->place.here)
        return "trial"; /* also without a note, if /data was full */
    if (!tried)
        return "none";
    if (answer->result[0] && strcmp(answer->result, "begun") != 0)
        return answer->result;
    if (answer->block.slot != tried)
        return answer->block.failed == tried ? "returned" : "none";
    return answer->block.left ? "chosen" : "kept";
}

static void print_quoted(const char *text) {
    putchar('"');
    for (; *text; text++) {
        if (*text == '"' || *text == '\\')
            putchar('\\');
        if (*text >= ' ' && *text <= '~')
            putchar(*text);
    }
    putchar('"');
}

static void print_json(const struct request *request, const struct answer *answer) {
    printf("{\"running\":\"%c\",\"chosen\":\"%c\",\"last\":\"%s\",\"reason\":", request->place.here, answer->block.slot,
           result(request, answer));
    print_quoted(answer->reason);
    printf(",\"trial\":");
    print_quoted(answer->progress);
    printf(",\"slots\":{");
    for (int i = 0; i < 2; i++) {
        printf("%s\"%c\":", i ? "," : "", 'A' + i);
        if (!answer->found[i]) {
            printf("null");
            continue;
        }
        printf("{\"version\":");
        print_quoted(answer->slots[i].version);
        printf(",\"serial\":%" PRIu64 "}", answer->slots[i].serial);
    }
    puts("}}");
}

static void print_text(const struct request *request, const struct answer *answer) {
    for (int i = 0; i < 2; i++) {
        const char slot = (char)('A' + i);
        printf("slot %c%s%s: ", slot, slot == request->place.here ? ", running" : "",
               slot == answer->block.slot ? ", started next" : "");
        if (answer->found[i])
            printf("version %s, serial %" PRIu64 "\n", answer->slots[i].version, answer->slots[i].serial);
        else
            puts("no version");
    }
    if (answer->tried[0])
        printf("last update: slot %c, %s%s%s\n", answer->tried[0], result(request, answer),
               answer->reason[0] ? ": " : "", answer->reason);
    if (answer->progress[0])
        printf("trial: %s\n", answer->progress);
}

int command_status(const struct request *request) {
    const struct place *place = &request->place;
    struct answer answer = {0};

    if (!place->here)
        return fail(1, "this machine was not started by the appliance's boot loader");
    if (choose_read(request, &answer.block))
        return 1;
    state_get(place->state, "tried", answer.tried, sizeof answer.tried);
    state_get(place->state, "result", answer.result, sizeof answer.result);
    state_get(place->state, "reason", answer.reason, sizeof answer.reason);
    place_line(place->progress, answer.progress, sizeof answer.progress);
    for (int i = 0; i < 2; i++)
        answer.found[i] = 'A' + i == place->here ? release_read(place->release, &answer.slots[i])
                                                 : release_of_slot(request->slots[i], place->mount, &answer.slots[i]);
    if (request->json)
        print_json(request, &answer);
    else
        print_text(request, &answer);
    return fflush(stdout) ? 1 : 0;
}
