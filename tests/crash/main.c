/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Programs that die, stop or lie, and others that must not be affected:
 * crash walk [POINT|PART/PARTS] | random KILLS SEED | restart | pins | crowd | epochs | retired | mute | stop |
 * stranger | hostile | worker
 */
#include <string.h>

#include "puppet.h"
#include "tests.h"

static const struct {
    const char *name;
    int (*test)(void);
} tests[] = {
    {"restart", test_restart}, {"pins", test_pins},     {"crowd", test_crowd}, {"epochs", test_epochs},
    {"retired", test_retired}, {"mute", test_mute},     {"stop", test_stop},   {"stranger", test_stranger},
    {"hostile", test_hostile}, {"worker", test_worker},
};
#define TESTS (sizeof tests / sizeof *tests)

static int (*find(const char *name))(void) {
    for (unsigned i = 0; i < TESTS; i++)
        if (!strcmp(tests[i].name, name))
            return tests[i].test;
    return NULL;
}

static void usage(void) {
    fputs("usage: crash walk [POINT|PART/PARTS] | random KILLS SEED", stderr);
    for (unsigned i = 0; i < TESTS; i++)
        fprintf(stderr, " | %s", tests[i].name);
    fputc('\n', stderr);
}

int main(int argc, char **argv) {
    const char *what = argc > 1 ? argv[1] : "";
    int (*test)(void), result = 2;

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
    else if ((test = find(what)))
        result = test();
    else
        usage();
    if (!result)
        director_end();
    return result;
}
