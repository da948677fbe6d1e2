/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxupdate: the boot loader's block and the slots of the disk. Scripts call it; people use `ddxctl update`. */
#include <startup.h>
#include <stdio.h>
#include <string.h>

#include "command.h"
#include "place.h"

static const char usage[] =
    "usage: ddxupdate [-root FOLDER] COMMAND [OPTION] BOOT [A B]\n"
    "\n"
    "  write          write the update on standard input into the slot that does not run\n"
    "  start          choose that slot for the next start\n"
    "  back           the same for an older version; in a trial: take the version back\n"
    "  keep           in a trial: keep the version now\n"
    "  seen           a technician knows that a version was taken back\n"
    "  status         what is in both slots\n"
    "For the scripts of a boot:\n"
    "  ended          note that a trial has ended with the former version; exit status 0: it has\n"
    "  block          report to the boot loader that this slot has come up; exit status 3: it is on trial\n"
    "  trial          watch the version until it can be kept; else print the reason, exit status 1\n"
    "  return         choose the former version again; exit status 1: a restart would not help\n"
    "  watchdog       start the watchdog, whose device takes the place of BOOT\n"
    "\n"
    "  BOOT, A, B     devices of the boot partition and of both slots; A and B for write, start, back, return, status\n"
    "  -older         write, start: also a version that is older than the running one\n"
    "  -json          status: one JSON object\n"
    "  -reason TEXT   return: why; ended: to be added to the reason\n"
    "  -root FOLDER   use the machine's files below this folder: proc, run, data, etc, sys\n"
    "  -help          this text; -version\n"
    "\n"
    "Exit status: 0, 1 failed, 2 refused or bad usage: nothing was written.\n";

static const struct {
    const char *name;
    int devices; /* how many follow */
    int (*run)(const struct request *request);
} commands[] = {{"block", 1, command_block},       {"write", 3, command_write},   {"start", 3, command_start},
                {"back", 3, command_back},         {"status", 3, command_status}, {"trial", 1, command_trial},
                {"keep", 1, command_keep},         {"return", 3, command_return}, {"ended", 1, command_ended},
                {"watchdog", 1, command_watchdog}, {"seen", 1, command_seen}};

static bool take(char ***word, const char *option) {
    const bool found = **word && !strcmp(**word, option);

    *word += found;
    return found;
}

static int run(struct request *request, const char *root, char **word) {
    const char *name = *word;

    if (!name)
        return fail(2, "bad usage; see ddxupdate -help");
    word++;
    for (request->reason = "";;) {
        if (take(&word, "-older"))
            request->older = true;
        else if (take(&word, "-json"))
            request->json = true;
        else if (word[0] && word[1] && take(&word, "-reason"))
            request->reason = *word++;
        else
            break;
    }
    int devices = 0;
    while (word[devices])
        devices++;
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        if (!strcmp(name, commands[i].name) && devices == commands[i].devices) {
            request->boot = word[0];
            request->slots[0] = devices > 1 ? word[1] : NULL;
            request->slots[1] = devices > 1 ? word[2] : NULL;
            place_find(&request->place, root);
            return commands[i].run(request);
        }
    return fail(2, "bad usage; see ddxupdate -help");
}

int main(int count, char **words) {
    struct request request = {0};
    const char *root = "";
    char **word = words + 1;

    descriptors_open();
    if (count == 2 && (!strcmp(words[1], "-help") || !strcmp(words[1], "--help")))
        return fputs(usage, stdout) < 0;
    if (count == 2 && (!strcmp(words[1], "-version") || !strcmp(words[1], "--version"))) {
        version_print("ddxupdate");
        return 0;
    }
    if (take(&word, "-root") && *word)
        root = *word++;
    return run(&request, root, word);
}
