/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Programs that die, stop or lie, and others that must not notice:
 * crash walk [POINT|PART/PARTS] | random KILLS SEED | restart | pins | crowd | epochs | mute | stop | stranger |
 * broken | hostile
 */
#include <string.h>

#include "puppet.h"
#include "tests.h"

int main(int argc, char **argv) {
    const char *what = argc > 1 ? argv[1] : "";
    int result = 2;

    setvbuf(stdout, NULL, _IOLBF, 0);
    if (!strcmp(what, "party"))
        return argc == 6 ? actor_main(*argv[2], (unsigned)atoi(argv[3]), (unsigned)atoi(argv[4]), atof(argv[5])) : 2;
    if (!strcmp(what, "puppet"))
        return argc == 3 ? puppet_main(atoi(argv[2])) : 2;
    director_begin();
    if (!strcmp(what, "walk"))
        result = test_walk(argc > 2 ? argv[2] : NULL);
    else if (!strcmp(what, "random") && argc == 4)
        result = test_random((unsigned)atoi(argv[2]), (unsigned)atoi(argv[3]));
    else if (!strcmp(what, "restart"))
        result = test_restart();
    else if (!strcmp(what, "pins"))
        result = test_pins();
    else if (!strcmp(what, "crowd"))
        result = test_crowd();
    else if (!strcmp(what, "epochs"))
        result = test_epochs();
    else if (!strcmp(what, "mute"))
        result = test_mute();
    else if (!strcmp(what, "stop"))
        result = test_stop();
    else if (!strcmp(what, "stranger"))
        result = test_stranger();
    else if (!strcmp(what, "broken"))
        result = test_broken();
    else if (!strcmp(what, "hostile"))
        result = test_hostile();
    else
        fprintf(stderr, "usage: crash walk [POINT|PART/PARTS] | random KILLS SEED | restart | pins | crowd | "
                        "mute | stop | stranger | broken | hostile\n");
    if (!result)
        director_end();
    return result;
}
