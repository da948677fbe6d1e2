/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The same test against a protocol that is broken on purpose: it must fail, and for that reason. */
#include <stdbool.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "director.h"
#include "tests.h"

#define ATTEMPTS 3 /* where a fault shows only if parties meet at the wrong moment, and a busy machine lets them miss */

/* All that comes out of a pipe, as a text; the caller's. */
static char *read_all(int fd) {
    size_t length = 0, room = 1 << 16;
    char *text = malloc(room);
    ssize_t got;

    while (text && (got = read(fd, text + length, room - length - 1)) > 0) {
        length += (size_t)got;
        if (length + 1 == room)
            text = realloc(text, room *= 2);
    }
    if (!text)
        fail("no memory");
    text[length] = 0;
    return text;
}

/* Whether the test fails, for that reason; *said is all that it said, the caller's. */
static bool fails(const char *test, const char *way, const char *complaint, char **said) {
    int ends[2], status;

    if (pipe(ends))
        fail("no pipe");
    pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        dup2(ends[1], 2);
        setenv("DDX_BROKEN", way, 1);
        if (!strcmp(test, "random"))
            execl("/proc/self/exe", "crash", test, "200", "1", (char *)NULL);
        execl("/proc/self/exe", "crash", test, (char *)NULL);
        _exit(127);
    }
    close(ends[1]);
    *said = read_all(ends[0]);
    waitpid(pid, &status, 0);
    close(ends[0]);
    return WIFEXITED(status) && WEXITSTATUS(status) && strstr(*said, complaint);
}

static void must_fail(const char *test, const char *way, const char *complaint) {
    char *said;
    int attempts = 1;
    while (!fails(test, way, complaint, &said)) {
        fputs(said, stderr);
        if (attempts++ == ATTEMPTS)
            fail("%s: ended without \"%s\", see above", way, complaint);
        free(said);
    }
    free(said);
    printf("%s: noticed: %s\n", way, complaint);
}

static const struct {
    const char *test, *way, *complaint;
} faults[] = {
    {"random", "blind", "torn: "},
    {"random", "miscount", "were counted"},
    {"random", "deaf", "no program takes over"},
    {"restart", "numbers", "a party complains"},
    {"pins", "unheard", "the reader does not ask"},
    {"restart", "half", "a party complains"},
    {"epochs", "hasty", "NEXT gives"},
    {"retired", "uncounted", "bytes of memory files exist"},
    {"retired", "pile", "keeps what it has not read"},
    {"stop", "patient", "a reader that holds a frame is stopped: "},
};

int test_broken(const char *only) {
    unsigned part = 0, parts = 1;

    if (only && (sscanf(only, "%u/%u", &part, &parts) != 2 || part >= parts)) {
        fprintf(stderr, "broken %s: a part such as 0/2 is needed\n", only);
        return 2;
    }
    for (unsigned i = part; i < sizeof faults / sizeof *faults; i += parts)
        must_fail(faults[i].test, faults[i].way, faults[i].complaint);
    return 0;
}
