/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxctl services, enable, disable ...: the appliance's own script does it, this only finds it. */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "ddxctl.h"

#define SCRIPT "/usr/libexec/ddx/control"
#define RECORDINGS "/usr/libexec/ddx/recordings"

bool is_control(const char *word) {
    static const char *const words[] = {"services", "health",  "enable", "disable", "start", "stop",
                                        "restart",  "status",  "logs",   "add",     "remove", "reset"};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (!strcmp(word, words[i]))
            return true;
    return false;
}

/* On a desk there is the program alone, without sticks to be found and mounted. */
int run_recordings(char **words) {
    static char script[] = RECORDINGS, program[] = "ddxrecordings", list[] = "list";
    char *short_form[] = {program, list, NULL};

    words[1] = script;
    execv(RECORDINGS, words + 1);
    words[1] = program;
    execvp(program, words[2] ? words + 1 : short_form);
    fprintf(stderr, "ddxctl: %s: %s; it comes with the recorder\n", program, strerror(errno));
    return 1;
}

int run_control(char **words) {
    char script[] = SCRIPT;
    words[0] = script;
    execv(SCRIPT, words);
    if (errno == ENOENT)
        fprintf(stderr, "ddxctl: %s: there are services in the appliance only, not on this machine\n", words[1]);
    else
        fprintf(stderr, "ddxctl: %s: %s\n", SCRIPT, strerror(errno));
    return 1;
}
