/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Commands to a recorder, sent as requests to its instance. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_request.h"
#include "ddxctl.h"

#define RECORDER "ddxvideosave"
#define ANSWER_WAIT 5.0 /* s: the recorder may wait for its disk */

#define WORDS "start, stop, split or pre-roll SECONDS is needed, and then at most an instance"

static int bad_usage(const char *word) {
    fprintf(stderr, "ddxctl: record: %s: " WORDS "\n", word);
    return 2;
}

int command_record(DDX_STORE_ID *id, const struct request *request) {
    static const struct {
        const char *word;
        struct ddx_change change;
    } commands[] = {{"start", {"recording", 1}}, {"stop", {"recording", 0}}, {"split", {"split", 1}}};
    char text[DDX_ANSWER_TEXT], *end;
    unsigned used = 0; /* words after the first one */
    struct ddx_change change = {"pre_roll", 0};
    size_t i = 0, count = sizeof commands / sizeof commands[0];

    while (i < count && strcmp(commands[i].word, request->item) != 0)
        i++;
    if (i < count) {
        change = commands[i].change;
    } else if (!strcmp(request->item, "pre-roll") && request->change_count) {
        change.value = strtoll(request->changes[used++], &end, 10);
        if (*request->changes[0] < '0' || *request->changes[0] > '9' || *end)
            return bad_usage(request->changes[0]);
    } else
        return bad_usage(request->item);
    if (request->change_count > used + 1)
        return bad_usage(request->changes[used + 1]);
    const char *recorder = request->change_count > used ? request->changes[used] : RECORDER;
    int error = ddx_request(id, recorder, &change, 1, ANSWER_WAIT, text);
    if (error == -EOPNOTSUPP)
        fprintf(stderr, "ddxctl: record: no recorder %s is running\n", recorder);
    else if (error)
        fprintf(stderr, "ddxctl: record: %s: %s\n", recorder, text);
    if (!error)
        return 0;
    return error == -EINVAL || error == -ERANGE || error == -EACCES ? 2 : 1;
}
