/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Kills programs that hang, so that runsv starts them again, and feeds the watchdog as long as that is sufficient. */
#include <string.h>
#include <time.h>

#include "dog.h"
#include "program.h"
#include "watch.h"

#define NS INT64_C(1000000000)
#define UNANSWERED 4 /* s that the store may keep us waiting: a request gives up after five */
#define RECORDER "ddxvideosave"
#define AGAIN (5 * NS) /* until a kill that was no help is tried again */

static const char *folder = "/run/service", *device = "/dev/watchdog";
static long silence = 6, timeout = 30;

static int64_t limit_of(const struct watched *service) {
    return (strcmp(service->name, WATCH_STORE) != 0 ? silence : UNANSWERED) * NS;
}

static void kill_silent(struct watch *watch) {
    for (unsigned i = 0; i < watch->count; i++) {
        struct watched *service = &watch->service[i];

        if (!watch_is_silent(watch, service, limit_of(service) + service->kills * AGAIN))
            continue;
        int error = watch_kill(service, folder);
        if (error)
            say("%s: no sign of life, and it cannot be killed: %s", service->name, strerror(-error));
        else
            say("%s: no sign of life from process %d, %s", service->name, (int)service->pid,
                service->kills == 1 ? "killed" : "killed again");
    }
}

/*
 * The store answers, and the recorder, if there is one, reports liveness. A reset does not cure a program that exits
 * again and again: it is restarted each time, and the rest of the robot continues.
 */
static bool all_well(const struct watch *watch) {
    const struct watched *recorder = watch_find(watch, RECORDER);

    return watch->answered && !(recorder && watch_is_silent(watch, recorder, limit_of(recorder)));
}

static void guard(struct dog *dog, bool well) {
    static bool told_absent, hungry;

    if (dog->file < 0) {
        int error = dog_open(dog, (int)timeout);

        if (!error)
            say("%s: resets the machine after %d s without food", dog->path, dog->timeout);
        else if (!told_absent)
            say("%s: %s; a machine that hangs stays so", dog->path, strerror(-error));
        told_absent = true;
    }
    if (well)
        dog_feed(dog);
    if (well == hungry)
        say(well ? "all is well again" : "the watchdog gets no food until store and recorder give signs of life");
    hungry = !well;
}

int main(int argc, char **argv) {
    const struct option_entry options[] = {
        {"silence", "SECONDS", "a program without a sign of life for so long is killed (default: 6)", OPTION_NUMBER,
         &silence, 3, 600},
        {"watchdog", "DEVICE", "the hardware watchdog (default: /dev/watchdog)", OPTION_TEXT, &device, 0, 0},
        {"timeout", "SECONDS", "it resets the machine after so long (default: 30)", OPTION_NUMBER, &timeout, 20, 600},
        {"services", "FOLDER", "runsvdir's (default: /run/service)", OPTION_TEXT, &folder, 0, 0},
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
    static struct watch watch;
    struct dog dog = {.path = device, .file = -1};
    DDX_STORE_ID *id = NULL;
    guard(&dog, true);
    while (!program_stopping()) {
        if (!id)
            id = ddx_store_open(NULL, (int)program.port, 0);
        if (id) {
            watch_look(&watch, folder, id);
            kill_silent(&watch);
        }
        guard(&dog, all_well(&watch));
        nanosleep(&(struct timespec){.tv_sec = 1}, NULL); /* a signal ends it */
    }
    ddx_store_close(id);
    return EXIT_OK;
}
