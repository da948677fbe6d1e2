/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "commands.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "recorder_file.h"
#include "recorder_frames.h"

struct command {
    const char *name;
    int64_t minimum, maximum;
    void (*execute)(struct recorder *recorder, int64_t value);
};

static void set_recording(struct recorder *recorder, int64_t value) {
    if (recorder->paused != !value)
        say("%s", value ? "recording continues, by request" : "recording stops, by request; frames are skipped");
    recorder_set_paused(recorder, !value);
}

static void split(struct recorder *recorder, int64_t value) {
    (void)value;
    if (recorder->pool && recorder->recording)
        recording_split(recorder->recording);
    else
        recorder_end_file(recorder);
}

static void set_pre_roll(struct recorder *recorder, int64_t value) {
    recorder->preroll.seconds = value;
}

static const struct command commands[] = {
    {"recording", 0, 1, set_recording},
    {"split", 1, 1, split},
    {"pre_roll", 0, PRE_ROLL_MAX, set_pre_roll},
};

static const struct command *find(const char *name) {
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        if (!strcmp(commands[i].name, name))
            return &commands[i];
    return NULL;
}

/* 0, or -errno with the reason in text. */
static int check(const struct recorder *recorder, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]) {
    for (unsigned i = 0; i < request->count; i++) {
        const char *name = request->change[i].name;
        int64_t value = request->change[i].value;
        const struct command *command = find(name);

        if (!command) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: no such parameter", name);
            return -EINVAL;
        }
        if (value < command->minimum || value > command->maximum) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: takes a whole number from %" PRId64 " to %" PRId64 ", not %" PRId64,
                     name, command->minimum, command->maximum, value);
            return -ERANGE;
        }
        if (!recorder->output.is_folder) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: records into one file; with a folder as -output there can be several",
                     name);
            return -EACCES;
        }
        int64_t fits = recorder->geometry.width /* otherwise not known yet; a later line reports it */
                           ? preroll_seconds_max(&recorder->geometry, recorder_ring_frames(recorder))
                           : PRE_ROLL_MAX;
        if (command->execute == set_pre_roll && value > fits) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: %" PRId64 " s do not fit into memory, %" PRId64 " s do; more: -ring",
                     name, value, fits);
            return -ERANGE;
        }
        if (command->execute == split && recorder->paused) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: it does not record now", name);
            return -EACCES;
        }
    }
    return 0;
}

void commands_open(struct recorder *recorder, DDX_STORE_ID *id) {
    recorder->requests = ddx_requests_open(id, recorder->program.instance);
    if (!recorder->requests)
        say("%s: cannot receive commands: %s", recorder->program.instance, ddx_error_text(-errno));
}

void commands_tick(struct recorder *recorder) {
    DDX_REQUEST request;
    char text[DDX_ANSWER_TEXT] = "";

    if (!recorder->requests || ddx_requests_take(recorder->requests, &request))
        return;
    int status = check(recorder, &request, text);
    for (unsigned i = 0; !status && i < request.count; i++)
        find(request.change[i].name)->execute(recorder, request.change[i].value);
    ddx_requests_answer(recorder->requests, status, text);
}

void commands_close(struct recorder *recorder) {
    ddx_requests_close(recorder->requests);
}
