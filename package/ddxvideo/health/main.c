/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Kills programs that hang, so that runsv starts them again, and feeds the watchdog as long as that is sufficient. */
#include <string.h>
#include <time.h>

#include "hw_watchdog.h"
#include "program.h"
#include "liveness.h"

#define NS INT64_C(1000000000)
#define UNANSWERED 4 /* s of waiting for the store; a request gives up after five */
#define RECORDER "ddxvideosave"
#define AGAIN (5 * NS) /* until a kill without effect is repeated */

static const char *folder = "/run/service", *device = "/dev/watchdog";
static long silence = 6, timeout = 30;

static int64_t limit_of(const struct watched *service) {
    return (strcmp(service->name, WATCH_STORE) != 0 ? silence : UNANSWERED) * NS;
}

static void kill_silent(struct liveness *liveness) {
    for (unsigned i = 0; i < liveness->count; i++) {
        struct watched *service = &liveness->service[i];

        if (!liveness_is_silent(liveness, service, limit_of(service) + service->kills * AGAIN))
            continue;
        int error = liveness_kill(service, folder);
        if (error)
            say("%s: no sign of life, and it cannot be killed: %s", service->name, strerror(-error));
        else
            say("%s: no sign of life from process %d, %s", service->name, (int)service->pid,
                service->kills == 1 ? "killed" : "killed again");
    }
}

/*
 * Whether the store answers, and the recorder, if there is one, is alive. Other programs do not count: a reset does not
 * cure a program that exits again and again, and the rest of the robot works without it.
 */
static bool all_well(const struct liveness *liveness) {
    const struct watched *recorder = liveness_find(liveness, RECORDER);

    return liveness->answered && !(recorder && liveness_is_silent(liveness, recorder, limit_of(recorder)));
}

static void guard(struct hw_watchdog *watchdog, bool well) {
    static bool told_absent, hungry;

    if (watchdog->file < 0) {
        int error = hw_watchdog_open(watchdog, (int)timeout);

        if (!error)
            say("%s: resets the machine after %d s without food", watchdog->path, watchdog->timeout);
        else if (!told_absent)
            say("%s: %s; a machine that hangs will not be reset", watchdog->path, strerror(-error));
        told_absent = true;
    }
    if (well)
        hw_watchdog_feed(watchdog);
    if (well == hungry)
        say(well ? "all is well again" : "the watchdog is not fed until store and recorder respond");
    hungry = !well;
}

int main(int argc, char **argv) {
    const struct option_entry options[] = {
        {"silence", "SECONDS", "kill a program after this long without a sign of life (default: 6)", OPTION_NUMBER,
         &silence, 3, 600},
        {"watchdog", "DEVICE", "the hardware watchdog (default: /dev/watchdog)", OPTION_TEXT, &device, 0, 0},
        {"timeout", "SECONDS", "of the watchdog, until it resets the machine (default: 30)", OPTION_NUMBER, &timeout,
         20, 600},
        {"services", "FOLDER", "folder of runsvdir (default: /run/service)", OPTION_TEXT, &folder, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    struct program program = {.name = "ddxhealth",
                              .purpose = "Supervises the services: a program that hangs is killed and started again;\n"
                                         "when that does not help the store or the recorder, the watchdog resets the\n"
                                         "machine. It does so as well when this program ends.",
                              .options = options,
                              .brief = true};

    program_start(&program, argc, argv);
    if (program.check)
        return EXIT_OK;
    static struct liveness liveness;
    struct hw_watchdog watchdog = {.path = device, .file = -1};
    DDX_STORE_ID *id = NULL;
    guard(&watchdog, true);
    while (!program_stopping()) {
        if (!id)
            id = ddx_store_open(NULL, (int)program.port, 0);
        if (id) {
            liveness_look(&liveness, folder, id);
            kill_silent(&liveness);
        }
        guard(&watchdog, all_well(&liveness));
        nanosleep(&(struct timespec){.tv_sec = 1}, NULL); /* a signal ends it */
    }
    ddx_store_close(id);
    return EXIT_OK;
}
